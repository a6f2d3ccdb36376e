"""Short runs of whatever is registered: what the conformance tests share beside `credit.testing`."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from credit.config import files, kinds
from credit.core.errors import UserError
from credit.runs import job
from credit.testing.short import composed, experiments

EVERY = sorted(name for name in files.options("experiment") if not name.startswith("generic"))  # with an environment
EXPERIMENTS = list(experiments())


@cache
def problems_of(*overrides: str) -> list[str]:
    """What is wrong with some overrides."""
    try:
        return list(job.check(composed(*overrides)).problems)
    except UserError as error:  # there is nothing where an option would go
        return [str(error)]


def options(kind: str) -> list[Any]:
    """Registered names of a kind."""
    return [pytest.param(name, marks=marks(kind, name)) for name in sorted(files.options(kind))]


def marks(kind: str, name: str) -> Any:
    """A file that starts from another of its kind, or is for one environment, is tried in CI, not by default."""
    node = files.read(files.options(kind)[name])
    others = [entry for entry in node.get("defaults", ()) if isinstance(entry, dict)]
    owned = str(node.get("_target_")).startswith("credit.envs.") and kind != "env"
    owned |= any(marks("features", entry["/features@features"]) for entry in others if "/features@features" in entry)
    return pytest.mark.thorough if owned or files.bases(kind, node) else ()


FILES = [
    pytest.param(kind, name, marks=marks(kind, name)) for kind in kinds.KINDS for name in sorted(files.options(kind))
]

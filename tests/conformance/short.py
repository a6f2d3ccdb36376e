"""Short runs of whatever is registered: what the conformance tests share beside `credit.testing`."""

from __future__ import annotations

from functools import cache
from typing import Any

from credit.config import files, kinds
from credit.core.errors import UserError
from credit.runs import job
from credit.testing.short import composed, experiments

EVERY = sorted(name for name in files.options("experiment") if not name.startswith("generic"))  # with an environment
EXPERIMENTS = list(experiments())
FILES = [(kind, name) for kind in kinds.KINDS for name in files.options(kind)]


@cache
def problems_of(*overrides: str) -> list[str]:
    """What is wrong with some overrides."""
    try:
        return list(job.check(composed(*overrides)).problems)
    except UserError as error:  # there is nothing where an option would go
        return [str(error)]


def options(kind: str) -> list[Any]:
    """Registered names of a kind."""
    return sorted(files.options(kind))

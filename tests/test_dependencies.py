"""The least version of every dependency is one that is tested."""

from __future__ import annotations

import tomllib
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
REQUIREMENTS = sorted(
    {
        *PROJECT["build-system"]["requires"],
        *PROJECT["project"]["dependencies"],
        *chain.from_iterable(PROJECT["project"]["optional-dependencies"].values()),
    }
)
TESTED = {
    canonicalize_name(pinned.name): Version(str(pinned.specifier).removeprefix("=="))
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
    for pinned in [Requirement(line)]
}


@pytest.mark.parametrize("text", REQUIREMENTS)
def test_the_least_version_is_of_the_minor_version_that_is_tested(text: str) -> None:
    requirement = Requirement(text)
    bounds = [Version(bound.version) for bound in requirement.specifier if bound.operator == ">="]
    if not bounds:  # stubs, and the extras that `test` takes
        return
    assert canonicalize_name(requirement.name) in TESTED, "constraints.txt says with which version it is tested"
    tested = TESTED[canonicalize_name(requirement.name)]
    assert tested in requirement.specifier
    assert [least.release[:2] for least in bounds] == [tested.release[:2]]

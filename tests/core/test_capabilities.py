"""Every part says which spaces and tasks it takes, and is told where they do not fit."""

from __future__ import annotations

from typing import ClassVar

import pytest

from credit.core.capabilities import misfits, parts_of, require
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.problem import Problem

TABLE = Problem.finite(10, 3, 7, (0,))
EPISODES = Problem.finite(10, 3, 7, (0,), episodic=True)
MAZE = Problem.vectors(4, 2, 300, (0,))


class Anything(Component):
    """Takes all."""


class Planner(Component):
    """Takes tables that go on for ever."""

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    setting: ClassVar = "continuing"


class Driver(Component):
    """Takes forces, whatever it sees; holds others."""

    actions: ClassVar = "vector"

    def __init__(self, *others: Component, named: dict[str, Component] | None = None) -> None:
        self.others, self.named = list(others), named or {}


def test_who_takes_all_fits_everywhere() -> None:
    assert [misfits(Anything, problem) for problem in (TABLE, EPISODES, MAZE)] == [[], [], []]


def test_every_misfit_is_told() -> None:
    assert misfits(Planner, TABLE) == []
    assert misfits(Planner, EPISODES) == ["a task that is continuing, and this one is episodic"]
    assert len(misfits(Planner, MAZE)) == 3
    assert misfits(Driver(), TABLE) == ["actions that are vectors (Box), and here they are numbers (Discrete)"]


def test_parts_are_found_once_with_their_place() -> None:
    shared = Anything()
    root = Driver(shared, named={"first": shared, "second": Planner()})
    assert [path for path, _ in parts_of(root, "agent")] == [
        "agent",
        "agent.others",
        "agent.named.second",
    ]


def test_all_parts_that_do_not_fit_are_named_at_once() -> None:
    with pytest.raises(UserError) as told:
        require({"agent": Driver(named={"inner": Planner()}), "assigner": Planner()}, EPISODES)
    lines = str(told.value).splitlines()
    assert [line.partition(":")[0] for line in lines] == ["agent", "agent.named.inner", "assigner"]
    assert all("choose another one, or another env" in line for line in lines)
    require({"agent": Anything(), "assigner": Planner()}, TABLE)

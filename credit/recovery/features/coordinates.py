"""The numbers of a step by name: what feature maps that a user writes in YAML speak of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from gymnasium.spaces import Box, Space
from torch import Tensor

from credit.core.errors import UserError, nearest
from credit.core.problem import FLOAT, Problem
from credit.core.steps import Steps

HUGE = 1e30  # a bound beyond it is none: environments write the largest float for infinity


@dataclass(frozen=True)
class Coordinate:
    """One number of a step.

    Attributes:
        name: `s`, `a`, or `s0`, `a1` of a vector; or as the environment calls it. of: the column that it is in.
        place: its number in a vector, None where the state or the action is a number. levels: how many values it has,
            None where it is a real number. low, high: its bounds, infinite where there are none; 0 and levels of those.
    """

    name: str
    of: Literal["states", "actions"]
    place: int | None
    levels: int | None
    low: float
    high: float

    def __call__(self, steps: Steps) -> Tensor:
        """Its values [...], float64."""
        column: Tensor = getattr(steps, self.of)
        return (column if self.place is None else column[..., self.place]).to(FLOAT)


class Coordinates:
    """All coordinates of a problem.

    Args:
        problem: its spaces, and the names that its environment gives.

    Raises:
        UserError: these names are too few, too many, or cannot be told apart.

    Example:
        >>> Coordinates(Problem.vectors(4, 2, window=300, seeds=(0,))).find("s3").place
        3
    """

    def __init__(self, problem: Problem) -> None:
        self.states = _named("s", "states", problem.observation_space)
        self.actions = _named("a", "actions", problem.action_space)
        self._names = tuple(problem.names)
        self._known = {each.name: each for each in (*self.states, *self.actions)}
        if not self._names:
            return
        if len(self._names) != len(self.states):
            raise UserError(
                f"the environment names {len(self._names)} coordinates ({', '.join(self._names)}), and a state has "
                f"{len(self.states)}: give one name for each"
            )
        for name, coordinate in zip(self._names, self.states, strict=True):
            if not str(name).isidentifier() or self._known.setdefault(name, coordinate) is not coordinate:
                raise UserError(
                    f"the environment calls coordinate {coordinate.name} of a state {name!r}: names are words of "
                    "letters, digits and _, and each is there once (s, a, s0, a0, … are taken)"
                )

    def find(self, name: int | str) -> Coordinate:
        """The coordinate of a name, or of a number: the place in the state, also as text, as keys of JSON are.

        Raises:
            UserError: there is none.
        """
        if isinstance(name, str) and name.isdecimal():
            name = int(name)
        if isinstance(name, str):
            if name in self._known:
                return self._known[name]
            first = f"{name}0" if f"{name}0" in self._known else None  # of a vector
            close = f"did you mean {first!r}?" if first else nearest(name, self._known).partition(" (")[0]
            hint = f"; {close}" if close.startswith("did") else ""
            raise UserError(f"there is no coordinate {name!r} here{hint} (valid: {self})")
        if not 0 <= name < len(self.states):
            raise UserError(f"there is no coordinate {name} here: a state has {len(self.states)} (valid: {self})")
        return self.states[name]

    def __str__(self) -> str:
        """Their names, of many the first and the last."""
        return ", ".join([*self._names, _listed(self.states), _listed(self.actions)])


def _named(letter: str, of: Literal["states", "actions"], space: Space) -> list[Coordinate]:
    if not isinstance(space, Box):
        levels = int(space.n)  # type: ignore[attr-defined]
        return [Coordinate(letter, of, None, levels, 0.0, float(levels))]
    bounds = (np.asarray(part, np.float64).reshape(-1) for part in (space.low, space.high))
    low, high = (np.where(np.abs(part) < HUGE, part, np.inf) for part in bounds)
    pairs = zip(low.tolist(), high.tolist(), strict=True)
    return [Coordinate(f"{letter}{i}", of, i, None, *pair) for i, pair in enumerate(pairs)]


def _listed(found: Sequence[Coordinate]) -> str:
    names = [each.name for each in found]
    return ", ".join(names) if len(names) <= 6 else f"{names[0]} … {names[-1]}"

"""Feature maps on (s, a) of tabular problems."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import PAIRS, Axis, Cells
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegativeInt
from credit.core.seams import FeatureMap
from credit.core.steps import Steps


class Identity(FeatureMap):
    """One feature a cell: the tabular ridge reference (4).

    Args:
        looks_at: what it tells apart.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def __init__(self, looks_at: Sequence[Axis] = PAIRS) -> None:
        self.looks_at = looks_at

    def start(self, problem: Problem) -> None:
        """Learn the sizes."""
        self._cells = Cells.over(self.looks_at, problem.horizon, problem.states, problem.actions)

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., cells]."""
        return torch.nn.functional.one_hot(self._cells.index(steps), self._cells.count).to(FLOAT)


class Bilinear(FeatureMap):
    """The features (1, s, a, s·a) of the advertiser's linear surrogate (3.3)."""

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """(1, s, a, s·a) [..., 4]."""
        s, a = steps.states.to(FLOAT), steps.actions.to(FLOAT)
        return torch.stack([torch.ones_like(s), s, a, s * a], dim=-1)


class Threshold(FeatureMap):
    """An action table for low states and one for high states: 2·A cells (3.3).

    Args:
        threshold: the last low state.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def __init__(self, threshold: NonNegativeInt = 4) -> None:
        self.threshold = threshold

    def start(self, problem: Problem) -> None:
        """Learn A."""
        self._actions = problem.actions

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., 2·A]: low states first."""
        high = (steps.states > self.threshold).to(torch.int64)
        return torch.nn.functional.one_hot(high * self._actions + steps.actions, 2 * self._actions).to(FLOAT)

"""A surrogate of one's own: this class says what it looks at, conf/reward/season.yaml makes it a reward model."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegativeInt
from credit.core.seams import FeatureMap
from credit.core.steps import Steps


class Season(FeatureMap):
    """Low and high season: the reward depends on which it is, and on the action.

    Args:
        from_state: the first state of the high season.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def __init__(self, from_state: NonNegativeInt = 6) -> None:
        self.from_state = from_state

    def start(self, problem: Problem) -> None:
        """Learn how many actions there are."""
        self._actions = problem.actions

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., 2·A]."""
        high = (steps.states >= self.from_state).long()
        return torch.nn.functional.one_hot(high * self._actions + steps.actions, 2 * self._actions).to(FLOAT)

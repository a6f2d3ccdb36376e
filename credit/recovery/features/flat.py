"""What is seen and what is done, as they are."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps


class Flat(FeatureMap):
    """State and action side by side: vectors as they are, numbers one-hot; for any spaces."""

    keeps: ClassVar = ()

    def start(self, problem: Problem) -> None:
        """Learn which are numbers, and how many there are of them."""
        self._states = problem.states if problem.finite_states else None
        self._actions = problem.actions if problem.finite_actions else None
        self._kind = FLOAT if problem.finite_states else torch.float32

    def __call__(self, steps: Steps) -> Tensor:
        """(s, a) [..., d]: d is S or O, plus A."""
        return torch.cat([self._flat(steps.states, self._states), self._flat(steps.actions, self._actions)], -1)

    def _flat(self, values: Tensor, count: int | None) -> Tensor:
        vectors = values if count is None else torch.nn.functional.one_hot(values, count)
        return vectors.to(self._kind)

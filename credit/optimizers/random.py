"""No learning at all: a reference level."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.dataset import Dataset
from credit.interfaces import CreditAssigner, Optimizer
from credit.streams import Stream
from credit.types import Problem


class Random(Optimizer):
    """Every action with the same probability, always."""

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """Make the action stream."""
        self._actions = problem.actions
        self._stream = Stream(problem, "random policy", "uniform", 1)

    def act(self, states: Tensor, step: int) -> Tensor:
        """A uniform action."""
        return (self._stream.next()[:, 0] * self._actions).to(torch.int64)

    def improve(self, dataset: Dataset, assigner: CreditAssigner) -> None:
        """Nothing is learned."""

    def policies(self) -> dict[str, Tensor]:
        """There is no deterministic policy to speak of."""
        return {}

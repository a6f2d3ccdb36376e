"""No learning at all: a reference level."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.dataset import Dataset
from credit.interfaces import CreditAssigner, Optimizer
from credit.streams import Stream
from credit.types import FLOAT, Problem


class Random(Optimizer):
    """Every action with the same probability, always."""

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """Make the action stream."""
        self._problem = problem
        self._stream = Stream(problem, "random policy", "uniform", 1)

    def act(self, states: Tensor, step: int) -> Tensor:
        """A uniform action."""
        return (self._stream.next()[:, 0] * self._problem.actions).to(torch.int64)

    def improve(self, dataset: Dataset, assigner: CreditAssigner) -> None:
        """Nothing is learned."""

    def policies(self) -> dict[str, Tensor]:
        """There is no deterministic policy to speak of."""
        return {}

    def executed(self) -> Tensor:
        """1/A for every action, [R, T, S, A] without memory of its own."""
        problem = self._problem
        shape = (problem.replicas, problem.window, problem.states, problem.actions)
        return torch.full((1, 1, 1, 1), 1 / problem.actions, dtype=FLOAT, device=problem.device).expand(shape)

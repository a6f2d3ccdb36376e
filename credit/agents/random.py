"""No learning at all: a reference level."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.interfaces import CreditAssigner, Optimizer, SomeDataset, SomeProblem
from credit.core.state import Stateful
from credit.core.streams import Stream, generators
from credit.core.trajectories import ContinuousProblem
from credit.core.types import FLOAT, Problem


class Random(Optimizer):
    """Every action with the same probability, always."""

    def start(self, problem: SomeProblem) -> None:
        """Make the action stream."""
        self._problem = problem
        if isinstance(problem, Problem):
            self._stream = Stream(problem, "random policy", "uniform", 1)
        else:
            self._forces = {name: _Forces(problem, f"random policy, {name}") for name in ("act", "evaluation")}

    def act(self, states: Tensor, step: int) -> Tensor:
        """A uniform action; where actions are real numbers, from [−1, 1]."""
        if not isinstance(self._problem, Problem):
            return self._forces["act"](states, step)
        return (self._stream.next()[:, 0] * self._problem.actions).to(torch.int64)

    def improve(self, dataset: SomeDataset, assigner: CreditAssigner) -> None:
        """Nothing is learned."""

    def policies(self) -> dict[str, Any]:
        """There is no deterministic policy to speak of; where policies are run to be evaluated, this one is."""
        return {} if isinstance(self._problem, Problem) else {"behaviour": self._forces["evaluation"]}

    def executed(self) -> Tensor:
        """1/A for every action, [R, T, S, A] without memory of its own."""
        problem = self._problem
        shape = (problem.replicas, problem.window, problem.states, problem.actions)
        return torch.full((1, 1, 1, 1), 1 / problem.actions, dtype=FLOAT, device=problem.device).expand(shape)


class _Forces(Stateful):
    """Uniform actions [n, A]; a round's are drawn at its start, so that no replica depends on how long others last."""

    keeps: ClassVar = ("_generators",)

    def __init__(self, problem: ContinuousProblem, purpose: str) -> None:
        self._generators = generators(problem.seeds, purpose)
        self._problem = problem

    def __call__(self, states: Tensor, step: int) -> Tensor:
        if step == 0:
            shape = (self._problem.window, len(states) // self._problem.replicas, self._problem.actions)
            drawn = [torch.from_numpy(g.uniform(-1, 1, shape)) for g in self._generators]
            self._round = torch.stack(drawn, 1).flatten(1, 2).to(states)
        return self._round[step]

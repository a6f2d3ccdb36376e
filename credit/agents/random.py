"""No learning at all: a reference level."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, CreditAssigner
from credit.core.state import Stateful
from credit.core.store import Store
from credit.core.streams import Stream, generators


class Random(Agent):
    """Every action with the same probability, always: numbers, or vectors in [−1, 1]; states are not looked at."""

    def start(self, problem: Problem) -> None:
        """Make the action streams."""
        kind, purpose = (Numbers, "random policy") if problem.finite_actions else (Forces, "random policy, act")
        self._acting: Numbers | Forces = kind(problem, purpose)
        self._judged: Numbers | Forces = kind(problem, "random policy, evaluation")

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """A uniform action."""
        return self._acting.act(states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Nothing is learned."""

    def policies(self) -> dict[str, Policy]:
        """Uniform actions, with random numbers of their own."""
        return {"behaviour": self._judged}


class Numbers(Policy, Stateful):
    """Uniform actions among A [R, K].

    Args:
        problem: A and the seeds. purpose: of the random numbers.
    """

    keeps: ClassVar = ("_stream",)

    def __init__(self, problem: Problem, purpose: str) -> None:
        self._count, self._replicas = problem.actions, problem.replicas
        self._stream = Stream(problem, purpose, "uniform", 1)

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """One draw for each copy."""
        return (self._stream.several(states.shape[1]) * self._count).to(torch.int64)

    def probabilities(self, states: Tensor, step: int) -> Tensor:
        """1/A for every action, without memory of its own."""
        chance = torch.full((1, 1, 1), 1 / self._count, dtype=FLOAT, device=states.device)
        return chance.expand(self._replicas, len(states), self._count)


class Forces(Policy, Stateful):
    """Uniform actions [R, K, A]; a round's are drawn at its start, so that none depends on how long others last."""

    keeps: ClassVar = ("_generators",)

    def __init__(self, problem: Problem, purpose: str) -> None:
        self._generators = generators(problem.seeds, purpose)
        self._problem = problem

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """The round's actions at its step."""
        now = int(step.flatten()[0])
        if now == 0:
            shape = (self._problem.window, states.shape[1], self._problem.actions)
            drawn = [torch.from_numpy(g.uniform(-1, 1, shape)) for g in self._generators]
            self._round = torch.stack(drawn, 1).to(states.device, torch.float32)
        return self._round[now]

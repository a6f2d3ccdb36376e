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
from credit.core.streams import Episodes, Stream, each_step


class Random(Agent):
    """Every action with the same probability, always: numbers, or vectors in [−1, 1]; states are not looked at."""

    def start(self, problem: Problem) -> None:
        """Make the action streams."""
        self._acting: Numbers | Forces
        self._judged: Numbers | Forces
        if problem.finite_actions:
            self._acting = Numbers(problem, each_step(problem, "random policy", "uniform", 1))
            self._judged = Numbers(problem, Episodes(problem, "random policy, evaluation", "uniform", 1))
        else:
            self._acting = Forces(each_step(problem, "random policy, act", "uniform", problem.actions))
            self._judged = Forces(Episodes(problem, "random policy, evaluation", "uniform", problem.actions))

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
        problem: A and R. stream: of the random numbers.
    """

    keeps: ClassVar = ("_stream",)

    def __init__(self, problem: Problem, stream: Stream | Episodes) -> None:
        self._count, self._replicas = problem.actions, problem.replicas
        self._stream = stream

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """One draw for each copy."""
        return (self._stream.rows(step)[..., 0] * self._count).to(torch.int64)

    def probabilities(self, states: Tensor, step: int) -> Tensor:
        """1/A for every action, without memory of its own."""
        chance = torch.full((1, 1, 1), 1 / self._count, dtype=FLOAT, device=states.device)
        return chance.expand(self._replicas, len(states), self._count)


class Forces(Policy, Stateful):
    """Uniform actions in [−1, 1] [R, K, A].

    Args:
        stream: of the random numbers.
    """

    keeps: ClassVar = ("_stream",)

    def __init__(self, stream: Stream | Episodes) -> None:
        self._stream = stream

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """One draw for each copy."""
        return (2 * self._stream.rows(step) - 1).to(torch.float32)

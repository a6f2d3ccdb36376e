"""What environments share whose MDP is known exactly."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import Environment


class Sizes(Protocol):
    """An MDP with S states and A actions."""

    @property
    def states(self) -> int:
        """S."""

    @property
    def actions(self) -> int:
        """A."""


class ExactEnvironment(Environment):
    """R replicas of one exact MDP, stepped together.

    Args:
        poison: replace the primitive reward by NaN wherever anything but the feedback could read it (the leak test:
            only the oracle metrics may change).
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def __init__(self, poison: bool = False) -> None:
        self.poison = poison

    @property
    @abstractmethod
    def mdp(self) -> Sizes:
        """The exact MDP."""

    def problem(self, window: int, seeds: tuple[int, ...], device: Any) -> Problem:
        """S, A, T and the seeds."""
        sizes = (self.mdp.states, self.mdp.actions, window)
        return Problem.finite(*sizes, tuple(seeds), device, self.setting == "episodic")

    def clock(self, problem: Problem) -> list[Tensor]:
        """The step of every replica [R, 1] at each step of a window, made once."""
        return list(torch.arange(problem.window, device=problem.device).repeat(problem.replicas, 1, 1).unbind(-1))

"""What environments share whose MDP is known exactly."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Protocol

import torch

from credit.core.interfaces import Environment
from credit.core.types import Problem


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

    domain: ClassVar = "tabular"

    def __init__(self, poison: bool = False) -> None:
        self.poison = poison

    @property
    @abstractmethod
    def mdp(self) -> Sizes:
        """The exact MDP."""

    def problem(self, window: int, seeds: tuple[int, ...], device: Any) -> Problem:
        """S, A, T and the seeds."""
        sizes = (self.mdp.states, self.mdp.actions, window)
        return Problem(*sizes, tuple(seeds), torch.device(device), self.setting == "episodic")

"""The label, spread over the window by a fixed rule; the spread always sums to the label."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.dataset import Dataset
from credit.interfaces import CreditAssigner
from credit.types import Problem, Windows


class _Rule(CreditAssigner):
    def start(self, problem: Problem) -> None:
        """A rule has no state."""

    def observe(self, dataset: Dataset) -> None:
        """A rule does not learn."""


class Delayed(_Rule):
    """The whole label on the last step, zero before it (29)."""

    def rewards(self, windows: Windows) -> Tensor:
        """(0, …, 0, Y) for every window."""
        rewards = torch.zeros_like(windows.states, dtype=windows.labels.dtype)
        rewards[..., -1] = windows.labels
        return rewards


class Uniform(_Rule):
    """The label in equal parts, Y/T on every step (the redistribution of IRCR)."""

    def rewards(self, windows: Windows) -> Tensor:
        """(Y/T, …, Y/T) for every window."""
        return (windows.labels / windows.states.shape[-1]).unsqueeze(-1).expand(windows.states.shape)

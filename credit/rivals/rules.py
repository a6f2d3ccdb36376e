"""The label, spread over the window by a fixed rule; the spread always sums to the label."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows


class _Rule(CreditAssigner):
    def start(self, problem: Problem) -> None:
        """A rule has no state."""

    def observe(self, store: Store) -> None:
        """A rule does not learn."""


class Delayed(_Rule):
    """The whole label on the last step, zero before it (29)."""

    def rewards(self, windows: Windows) -> Tensor:
        """(0, …, 0, Y) for every window."""
        return windows.to_steps(windows.labels) * windows.final


class Uniform(_Rule):
    """The label in equal parts, Y/T on every step (the redistribution of IRCR); the mean of all where there is none."""

    def rewards(self, windows: Windows) -> Tensor:
        """(Y/T, …, Y/T) for every window."""
        shares = windows.labels / windows.lengths
        if windows.labelled is not None:
            known = (windows.lengths * windows.labelled).sum(1, keepdim=True)
            mean = windows.labels.sum(1, keepdim=True) / known.clamp(min=1)
            shares = torch.where(windows.labelled, shares, mean)
        return windows.to_steps(shares)

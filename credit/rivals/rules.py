"""The label, spread over the window by a fixed rule; the spread always sums to the label."""

from __future__ import annotations

from torch import Tensor

from credit.core.interfaces import CreditAssigner, SomeDataset, SomeProblem, SomeWindows


class _Rule(CreditAssigner):
    def start(self, problem: SomeProblem) -> None:
        """A rule has no state."""

    def observe(self, dataset: SomeDataset) -> None:
        """A rule does not learn."""


class Delayed(_Rule):
    """The whole label on the last step, zero before it (29)."""

    def rewards(self, windows: SomeWindows) -> Tensor:
        """(0, …, 0, Y) for every window."""
        rewards: Tensor = windows.to_steps(windows.labels) * windows.final
        return rewards


class Uniform(_Rule):
    """The label in equal parts, Y/T on every step (the redistribution of IRCR)."""

    def rewards(self, windows: SomeWindows) -> Tensor:
        """(Y/T, …, Y/T) for every window."""
        rewards: Tensor = windows.to_steps(windows.labels / windows.lengths)
        return rewards

"""The label, spread over the window by a fixed rule; the spread always sums to the label."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows


class _Rule(CreditAssigner):
    """What the rules share: a window without a label is given the mean of its replica's labels so far.

    Nothing would be a reward, too: the best of all where rewards are negative. The mean moves as labels come, so that
    memories are relabelled then; where every window has a label, a rule has nothing to learn.
    """

    _seen: Tensor | None = None
    _lacking = False

    def start(self, problem: Problem) -> None:
        """No label was seen, and none is lacking."""
        self._seen, self._lacking = problem.zeros(3), False

    def observe(self, store: Store) -> None:
        """Remember what the mean label is, and whether anybody needs it."""
        new = store.new
        found = _labelled(new)
        self._seen = found if self._seen is None else self._seen + found
        if new.labelled is not None:
            self._lacking = self._lacking or bool(((new.lengths > 0) & ~new.labelled).any())

    @property
    def learns(self) -> bool:
        """Whether what old windows are given moves with the mean: where a label was lacking."""
        return self._lacking

    def _mean(self, windows: Windows, by: int) -> Tensor:
        """The mean label so far [R, 1], by window (1) or by step (2); of these windows, where none were observed."""
        seen = _labelled(windows) if self._seen is None else self._seen
        return seen[:, :1] / seen[:, by : by + 1].clamp(min=1)


class Delayed(_Rule):
    """The whole label on the last step, zero before it (29); where there is none, the mean label so far."""

    def rewards(self, windows: Windows) -> Tensor:
        """(0, …, 0, Y) for every window."""
        labels = windows.labels
        if windows.labelled is not None:
            labels = torch.where(windows.labelled, labels, self._mean(windows, 1))
        return windows.to_steps(labels) * windows.final


class Uniform(_Rule):
    """The label in equal parts, Y/T on every step (the redistribution of IRCR); where there is none, the mean part."""

    def rewards(self, windows: Windows) -> Tensor:
        """(Y/T, …, Y/T) for every window."""
        shares = windows.labels / windows.lengths
        if windows.labelled is not None:
            shares = torch.where(windows.labelled, shares, self._mean(windows, 2))
        return windows.to_steps(shares)


def _labelled(windows: Windows) -> Tensor:
    """Of the windows that have a label, what those sum to, how many they are, and how many steps [R, 3]."""
    steps = windows.lengths
    known = torch.ones_like(steps) if windows.labelled is None else windows.labelled.to(steps)
    return torch.stack([windows.labels.sum(1), known.sum(1), (steps * known).sum(1)], 1)

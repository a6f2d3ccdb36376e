"""In which units a network sees labels: theirs, or standard ones."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.state import Stateful
from credit.core.windows import Windows

TINY = 1e-6  # a deviation that is smaller, as a part of the largest label, is rounding
FAR = 2.0  # a network's unit stays until the labels' deviation is so many times as large, or as small


class Units(Stateful):
    """Y = c·L + s·Y′ for a window of L steps: c is the mean label a step, s the deviation of what is left.

    A network that is fitted to Y′ has the same noise, prior and sparsity whatever the reward's unit is, and says c
    where it knows nothing. Both are kept until s has doubled or halved, since what the network knows is in these units.

    Args:
        problem: R. standard: whether to; else c = 0 and s = 1.
    """

    keeps: ClassVar = ("_each", "_unit", "_known")

    def __init__(self, problem: Problem, standard: bool) -> None:
        self._standard = standard
        self._each = torch.zeros(problem.replicas, 1, device=problem.device)
        self._unit = torch.ones_like(self._each)
        self._known = torch.zeros_like(self._each, dtype=torch.bool)

    def look(self, windows: Windows) -> None:
        """Take the units of these windows, where they are far from what they were."""
        if not self._standard:
            return
        labels, lengths = windows.labels, windows.lengths.to(windows.labels)
        held = torch.ones_like(labels) if windows.labelled is None else windows.labelled.to(labels)
        each = labels.sum(1, keepdim=True) / (lengths * held).sum(1, keepdim=True).clamp(min=1)
        count = held.sum(1, keepdim=True).clamp(min=1)
        unit = ((labels - each * lengths).square() * held).sum(1, keepdim=True).div(count).sqrt()
        unit = torch.where(unit > TINY * labels.abs().amax(1, keepdim=True), unit, 1.0).float()
        there = held.any(1, keepdim=True)
        far = there & (~self._known | (unit > FAR * self._unit) | (unit < self._unit / FAR))
        self._each, self._unit = torch.where(far, each.float(), self._each), torch.where(far, unit, self._unit)
        self._known = self._known | there

    def scaled(self, windows: Windows) -> Tensor:
        """Y′ [R, K], float32."""
        if not self._standard:
            return windows.labels.float()
        return (windows.labels.float() - self._each * windows.lengths) / self._unit

    def rewards(self, mean: Tensor, variance: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and variance of rewards [R, n], of those in units of Y′."""
        if not self._standard:
            return mean, variance
        return mean.mul_(self._unit).add_(self._each), variance.mul_(self._unit.square())

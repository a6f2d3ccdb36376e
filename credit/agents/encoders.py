"""Encoders: what networks see of a state that is a vector."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.component import Kind
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Positive
from credit.core.seams import Encoder
from credit.core.windows import Windows

TINY = 1e-6  # a coordinate with a smaller deviation is a constant, and is not scaled


class Normalize(Encoder):
    """Mean zero and deviation one of each coordinate, by all training steps of a replica so far.

    Mean and sum of squared differences are merged round by round (Chan, Golub, LeVeque 1979), for each replica by its
    own rows, from all its copies. As long as there was no step, states are seen as they are: give PPO, which learns
    before it looks, `trainer.random_steps`.

    Args:
        clip: how many deviations from the mean a coordinate may be seen to lie, at most.

    Example: after many steps of states with mean 3 and deviation 2, the state 7 is seen as 2.
        >>> encoder = Normalize()
        >>> encoder.start(problem)
        >>> encoder.observe(store.new)
        >>> encoder(states)
    """

    observations: ClassVar[Kind] = "vector"
    keeps: ClassVar = ("_count", "_mean", "_squares")

    def __init__(self, clip: Positive = 10.0) -> None:
        self.clip = clip

    def start(self, problem: Problem) -> None:
        """No step was taken."""
        self._count = problem.zeros(1)
        self._mean, self._squares = problem.zeros(problem.observations), problem.zeros(problem.observations)

    def observe(self, windows: Windows) -> None:
        """Count the rows of new windows."""
        counts = [len(windows)] * len(self._mean) if windows.count is None else windows.count.tolist()
        for replica, count in enumerate(counts):  # by itself, so that it comes to the same numbers as if it were alone
            if count:
                self._merge(replica, windows.states[replica, :count].to(FLOAT))

    def __call__(self, states: Tensor) -> Tensor:
        """(s − mean) / deviation, float32 [R, n, O], within the clip."""
        deviation = (self._squares / self._count.clamp(min=1)).sqrt()
        scale = torch.where(deviation > TINY, deviation, 1.0)
        apart = states - self._mean.unsqueeze(1)  # float64: a mean may be large beside the deviation
        return apart.div_(scale.unsqueeze(1)).clamp_(-self.clip, self.clip).float()

    def _merge(self, replica: int, rows: Tensor) -> None:
        """n = a + b; mean += δ b/n; squares += squares of b + δ² ab/n, with δ the difference of the means."""
        before, added = self._count[replica].clone(), len(rows)
        mean = rows.mean(0)
        apart, total = mean - self._mean[replica], before + added
        self._squares[replica] += (rows - mean).square().sum(0) + apart.square() * (before * added / total)
        self._mean[replica] += apart * (added / total)
        self._count[replica] = total

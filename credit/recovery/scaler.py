"""How a pseudo-reward is scaled and clipped before a policy optimizer sees it."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from credit.core.ranges import Positive, Probability
from credit.core.seams import Scaler

TINY = 1e-6  # a deviation that is smaller, as a part of the largest reward, is rounding


class Standard(Scaler):
    """Divide by the standard deviation, clip around the median, and let the best steps be worth zero.

    Networks of unit scale learn from rewards of unit scale; a clip close to the median keeps a few steps from deciding
    all values; and where no reward is above zero, to arrive sooner is better.

    Args:
        clip: how far a reward may lie from the median, in standard deviations.
        quantile: that of the clipped rewards which becomes zero, and the most that a reward can be; null for neither.
    """

    def __init__(self, clip: Positive = 1.0, quantile: Probability | None = 0.99) -> None:
        self.clip, self.quantile = clip, quantile
        self.cap = None if quantile is None else 0.0

    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        """The scaled rewards [n] of one replica, and the deviation [] by which they were divided; a constant is not."""
        scaled, unit = self.like(rewards)
        return scaled(rewards), unit

    def like(self, seen: Tensor) -> tuple[Callable[[Tensor], Tensor], Tensor]:
        """The same with the deviation, the median and the quantile of others [n]."""
        if not len(one_replica(seen)):
            return lambda rewards: rewards, seen.new_ones(())
        deviation = seen.std(correction=0)
        unit = torch.where(deviation > TINY * seen.abs().max(), deviation, 1.0)
        median = (seen / unit).quantile(0.5)

        def clipped(rewards: Tensor) -> Tensor:
            return (rewards / unit).clamp(median - self.clip, median + self.clip)

        if self.quantile is None:
            return clipped, unit
        best = clipped(seen).quantile(self.quantile)
        return lambda rewards: (clipped(rewards) - best).clamp_(max=0), unit


class RootMeanSquare(Scaler):
    """Divide by the root of the mean square: no reward changes its sign, and none is cut off.

    A deviation would do for most, but not for rewards that hardly differ, as those of a task that pays for every step.
    """

    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        """The scaled rewards [n] of one replica, and the unit [] by which they were divided; 1 where all are zero."""
        scaled, unit = self.like(rewards)
        return scaled(rewards), unit

    def like(self, seen: Tensor) -> tuple[Callable[[Tensor], Tensor], Tensor]:
        """The same with the mean square of others [n]."""
        size = one_replica(seen).square().mean().sqrt() if len(seen) else seen.new_zeros(())
        unit = torch.where(size > 0, size, 1.0)
        return lambda rewards: rewards / unit, unit


def one_replica(rewards: Tensor) -> Tensor:
    """Rewards [n], of one replica.

    Raises:
        ValueError: of several.
    """
    if rewards.dim() != 1:
        raise ValueError(f"a scaler is given the rewards of one replica [n], and these are {list(rewards.shape)}")
    return rewards

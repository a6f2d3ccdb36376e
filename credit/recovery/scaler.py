"""How a pseudo-reward is scaled and clipped before a policy optimizer sees it."""

from __future__ import annotations

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
        clip: how far a reward may lie from the median, in standard deviations; null for as far as it likes.
        quantile: that of the clipped rewards which becomes zero, and the most that a reward can be; null for neither.
    """

    def __init__(self, clip: Positive | None = 1.0, quantile: Probability | None = 0.99) -> None:
        self.clip, self.quantile = clip, quantile

    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        """The scaled rewards [n] of one replica, and the deviation [] by which they were divided; a constant is not."""
        if rewards.dim() != 1:
            raise ValueError(f"a scaler is given the rewards of one replica [n], and these are {list(rewards.shape)}")
        if not len(rewards):
            return rewards, rewards.new_ones(())
        deviation = rewards.std(correction=0)
        unit = torch.where(deviation > TINY * rewards.abs().max(), deviation, 1.0)
        scaled = rewards / unit
        if self.clip is not None:
            median = scaled.quantile(0.5)
            scaled = scaled.clamp(median - self.clip, median + self.clip)
        return (scaled if self.quantile is None else (scaled - scaled.quantile(self.quantile)).clamp_(max=0)), unit

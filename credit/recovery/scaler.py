"""How a pseudo-reward is scaled and clipped before a policy optimizer sees it."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.continuous import Scaler
from credit.core.types import Positive, Probability

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

    def __call__(self, rewards: Tensor) -> Tensor:
        """The scaled rewards [N] of one replica; constant rewards are not divided."""
        if not len(rewards):
            return rewards
        deviation = rewards.std(correction=0)
        scaled = rewards / torch.where(deviation > TINY * rewards.abs().max(), deviation, 1.0)
        median = scaled.quantile(0.5)
        scaled = scaled.clamp(median - self.clip, median + self.clip)
        return scaled if self.quantile is None else (scaled - scaled.quantile(self.quantile)).clamp_(max=0)

"""What an exact judge judges by: P and r are known, and so is what the best policy is worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from credit.core.cells import Cells


@dataclass(frozen=True)
class ContinuingTruth:
    """Of a task that goes on for ever, by the average reward.

    Attributes:
        gain: g*, reward a step. policy: π* [S]. occupancy: its stationary distribution [S]. reward: r(s, a) [S, A].
    """

    gain: float
    policy: Tensor
    occupancy: Tensor
    reward: Tensor


@dataclass(frozen=True)
class EpisodicTruth:
    """Of a task of T steps, for the objective that the labels show, under the start distribution.

    Attributes:
        best: V*. random: V of uniform actions.
        reward: cells → the reward [N] that the label shows; NaN where cells cannot say it.
        evaluate: actions [R, T, S], or probabilities [R, T, S, A] → values [R].
    """

    best: float
    random: float
    reward: Callable[[Cells], Tensor]
    evaluate: Callable[[Tensor], Tensor]

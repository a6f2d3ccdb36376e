"""What is true of an environment whose P and r are known: what exact judges judge by, and nobody else sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from credit.core.cells import Cells


@dataclass(frozen=True)
class ContinuingTruth:
    """Of a task that goes on for ever, judged by its average reward (42).

    Attributes:
        gain: g*, reward a step. policy: π* [S]. occupancy: its stationary distribution [S]. reward: r [S, A].
        evaluate: policies, actions [R, S] or probabilities [R, S, A] → their rewards a step [R], from the start on.
    """

    gain: float
    policy: Tensor
    occupancy: Tensor
    reward: Tensor
    evaluate: Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class EpisodicTruth:
    """Of episodes of T steps, for one objective of the label.

    Attributes:
        best: V*, under the start distribution. random: V of uniform actions.
        table: cells → the reward [N] that the label shows; NaN where they cannot express it.
        evaluate: policies, actions [R, T, S] or probabilities [R, T, S, A] → their values [R].
    """

    best: float
    random: float
    table: Callable[[Cells], Tensor]
    evaluate: Callable[[Tensor], Tensor]


Truth = ContinuingTruth | EpisodicTruth

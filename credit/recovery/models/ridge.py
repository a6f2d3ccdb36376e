"""What reward models share that are fitted by ridge regression."""

from __future__ import annotations

from abc import abstractmethod

from torch import Tensor

from credit.core.seams import RewardModel
from credit.core.steps import Steps
from credit.recovery.uncertainty.bootstrap import FitUncertainty


class RidgeModel(RewardModel):
    """A reward model with the confidence set of ridge regression."""

    uncertainty: FitUncertainty

    @abstractmethod
    def leverage(self, steps: Steps | None = None) -> Tensor:
        """φᵀV⁻¹φ of every place [R, N], or of other steps [n]: the squared width of the proof's confidence set (38)."""

    def prior(self, visits: Tensor) -> Tensor | float:
        """What the uncertainty adds to the variance of a reference after N visits [R, N]."""
        return self.uncertainty.prior(visits)

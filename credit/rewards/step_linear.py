"""The linear estimator of single steps: ridge regression of labels on summed features, with its analytic variance."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.continuous import StepModel
from credit.errors import RunError
from credit.interfaces import FeatureMap
from credit.tensors import CACHED
from credit.trajectories import ContinuousProblem, Moves, Trajectories
from credit.types import FLOAT, Positive


class StepLinear(StepModel):
    """Ridge regression on a feature map of steps (6); on the cells of a maze it is the box surrogate (3.3).

    θ = (XᵀX + λI)⁻¹XᵀY with x_i = Σ_{t∈i} φ(s_t, a_t) / unit; a step has the reward φᵀθ / unit with the variance
    σ̂²·φᵀ(XᵀX + λI)⁻¹φ / unit² (4.1), where σ̂² is the mean squared residual of the labels. float64 within; what it
    predicts is float32.

    Args:
        name: the model's name in metrics, files and figures.
        features: the feature map φ.
        regularization: λ > 0.
        unit: steps that are counted as one: it sets the scale on which λ acts.
    """

    keeps: ClassVar = ("_fits",)

    def __init__(self, name: str, features: FeatureMap, regularization: Positive = 1.0, unit: Positive = 10.0) -> None:
        self.name = name
        self.features = features
        self.regularization = regularization
        self.unit = unit

    def start(self, problem: ContinuousProblem) -> None:
        """Nothing is known: θ = 0 and no residuals, so that the variance is zero."""
        self._problem = problem
        self.features.start(problem)
        self._fits: list[tuple[Tensor, Tensor]] = []  # of each replica: θ [d], σ̂²·(XᵀX + λI)⁻¹ [d, d]

    def fit(self, inputs: Tensor, trajectories: Trajectories) -> None:
        """Solve the normal equations of all trajectories.

        Raises:
            RunError: a label or a feature is not finite.
        """
        sums = trajectories.sums(inputs.to(FLOAT)) / self.unit
        fits = list(zip(*_ridge(sums, trajectories.labels.to(FLOAT), self.regularization), strict=True))
        bad = [s for s, (theta, _) in zip(self._problem.seeds, fits, strict=True) if not theta.isfinite().all()]
        if bad:
            raise RunError(
                f"reward model {self.name!r}: a coefficient of seed {', '.join(map(str, bad))} is not finite after "
                f"{sums.shape[1]} trajectories; are labels and states finite?"
            )
        self._fits = fits

    def predict(self, inputs: Tensor, moves: Moves) -> tuple[Tensor, Tensor]:
        """Mean [N] and variance [N] of rows, float32; zero before the first fit."""
        mean, variance = (inputs.new_zeros(len(inputs), dtype=torch.float32) for _ in range(2))
        for replica, (theta, covariance) in enumerate(self._fits):
            (own,) = (moves.replica == replica).nonzero(as_tuple=True)
            for rows in own.split(max(1, CACHED // (4 * inputs.shape[1]))):
                phi = inputs[rows].to(FLOAT) / self.unit
                mean[rows] = (phi @ theta).float()
                variance[rows] = ((phi @ covariance) * phi).sum(-1).float()
        return mean, variance

    def theta(self, replica: int) -> Tensor:
        """The coefficients of a fit [d]: reward for `unit` steps."""
        return self._fits[replica][0]


def _ridge(x: Tensor, labels: Tensor, penalty: float) -> tuple[Tensor, Tensor]:
    """θ [..., d], and its covariance [..., d, d] with the mean squared residual as the noise's variance.

    Args:
        x: summed features [..., K, d]. labels: [..., K]. penalty: λ.
    """
    inverse = torch.linalg.inv(x.mT @ x + penalty * torch.eye(x.shape[-1], dtype=x.dtype, device=x.device))
    theta = inverse @ (x.mT @ labels.unsqueeze(-1))
    noise = (labels.unsqueeze(-1) - x @ theta).square().mean((-2, -1), keepdim=True)
    return theta.squeeze(-1), noise * inverse

"""How MSE proxies become weights: pure equations on [..., M, N], the reference is model 0."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from scipy.optimize import nnls
from torch import Tensor

from credit.core.ranges import Positive
from credit.core.seams import Mixer
from credit.recovery.uncertainty.bootstrap import Bootstrap


def relative_mse_weights(mse: Tensor, alpha: float, epsilon: float = 1e-12) -> Tensor:
    """Relative-MSE softmax, equations (12)–(14).

    Args:
        mse: proxies [..., M, N].
        alpha: α, small values pick the best model, large ones average.
        epsilon: ε, floor of the scale; all-zero proxies then give equal weights.

    Returns:
        Weights of the same shape that sum to one over M.
    """
    excess = mse - mse.amin(-2, keepdim=True)
    scale = median(mse).clamp(min=epsilon).unsqueeze(-2)
    return torch.softmax(-excess / (scale * alpha), dim=-2)


def median(values: Tensor) -> Tensor:
    """The median over M of [..., M, N], the mean of the middle two when M is even; [..., N]."""
    ordered = values.sort(dim=-2).values
    count = values.shape[-2]
    return (ordered[..., (count - 1) // 2, :] + ordered[..., count // 2, :]) / 2


def best_model(mse: Tensor) -> Tensor:
    """Index of the locally best model (16) for proxies [..., M, N]; on ties the reference wins; [..., N]."""
    least, best = mse[..., 0, :], torch.zeros_like(mse[..., 0, :], dtype=torch.int64)
    for index in range(1, mse.shape[-2]):  # argmin over an inner dimension is several times slower
        better = mse[..., index, :] < least
        least, best = torch.where(better, mse[..., index, :], least), best.masked_fill(better, index)
    return best


def mix(weights: Tensor, predictions: Tensor) -> Tensor:
    """The mixed reward Σ_j w_j r̂_j (15) of [..., M, N]; [..., N]."""
    return (weights * predictions).sum(-2)


class RelativeMSE(Mixer):
    """The paper's mixture: a softmax of the relative excess MSE (12)–(14).

    Args:
        alpha: α > 0; smaller is closer to picking the locally best model.
        epsilon: floor of the scale (12).
    """

    def __init__(self, alpha: Positive = 0.5, epsilon: Positive = 1e-12) -> None:
        self.alpha = alpha
        self.epsilon = epsilon

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """Equation (14)."""
        return relative_mse_weights(mse, self.alpha, self.epsilon)


class ReferenceOnly(Mixer):
    """All weight on the reference model; surrogates are fitted but not used."""

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """One for the reference, zero for the others."""
        weights = torch.zeros_like(mse)
        weights[..., 0, :] = 1
        return weights


class Uniform(Mixer):
    """The same weight for every model, everywhere."""

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """1/M."""
        return torch.full_like(mse, 1 / mse.shape[-2])


class Best(Mixer):
    """All weight on the locally best model: the limit α → 0 of the paper's mixture."""

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """One for the model of (16), zero for the others."""
        return torch.zeros_like(mse).scatter_(-2, best_model(mse).unsqueeze(-2), 1.0)


class Stacking(Mixer):
    """One weight a model, everywhere: those that predict held-out labels best (Breiman's stacked regressions).

    min ‖Y − Σ_j w_j Ŷ_j‖² over w ≥ 0, Σ w = 1, where Ŷ_j are out-of-bag: from draws which have not seen the window.
    """

    needs: ClassVar = {"uncertainty": Bootstrap}
    sees_label_errors: ClassVar = True

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """The stacked weights, the same for every cell."""
        assert label_errors is not None
        stacked = stacked_weights(label_errors)
        return stacked.unsqueeze(-1).expand_as(mse)


def stacked_weights(errors: Tensor) -> Tensor:
    """w [..., M] that minimise wᵀGw over w ≥ 0, Σ w = 1, for G [..., M, M] symmetric and positive definite.

    The minimum of ½wᵀGw − Σ w over w ≥ 0 is a multiple of it, and with G = LLᵀ that is least squares: ‖Lᵀw − L⁻¹1‖.
    """
    factor = torch.linalg.cholesky(errors)
    target = torch.linalg.solve_triangular(factor, torch.ones_like(errors[..., :1]), upper=False)
    count = errors.shape[-1]
    matrices, vectors = factor.mT.reshape(-1, count, count).cpu().numpy(), target.reshape(-1, count).cpu().numpy()
    found = np.stack([nnls(matrix, vector)[0] for matrix, vector in zip(matrices, vectors, strict=True)])
    weights = torch.from_numpy(found / found.sum(-1, keepdims=True))
    return weights.view(errors.shape[:-1]).to(errors.device)

"""How MSE proxies become weights: pure equations on [..., M, N], the reference is model 0."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.ranges import Positive
from credit.core.seams import Mixer
from credit.core.shapes import agree
from credit.recovery.uncertainty.bootstrap import Bootstrap

ROUNDING = 1e-13  # of the trace: what a matrix that is all but singular needs to have a Cholesky factor


def relative_mse_weights(mse: Tensor, alpha: float, epsilon: float = 1e-12) -> Tensor:
    """Relative-MSE softmax, equations (12)–(14).

    Its limits: at α = 0 the locally best model has all the weight; a model whose proxy is infinite has none, and the
    scale is that of the others; where all are infinite, all have the same.

    Args:
        mse: proxies [..., M, N].
        alpha: α ≥ 0, small values pick the best model, large ones average.
        epsilon: ε, floor of the scale; all-zero proxies then give equal weights.

    Returns:
        Weights of the same shape that sum to one over M.

    Raises:
        ValueError: α < 0, or the shape is another.
    """
    agree(mse=(mse, "M N"))
    if alpha <= 0:
        if alpha < 0:
            raise ValueError(f"alpha={alpha}: must be at least 0")
        return best_weights(mse)
    limits = torch.finfo(mse.dtype)
    mse = mse.clamp(max=limits.max)  # where all are infinite, none is worse than another
    ordered = mse.sort(dim=-2).values
    alpha = max(alpha, limits.tiny)  # else α, or α·scale, may vanish
    scale = _median(ordered).clamp(min=max(epsilon, limits.tiny / alpha))
    return torch.softmax((ordered[..., :1, :] - mse).div_(scale.mul_(alpha).unsqueeze(-2)), dim=-2)


def median(values: Tensor) -> Tensor:
    """The median over M of those of [..., M, N] that are finite, the mean of the middle two; inf where none is."""
    agree(values=(values, "M N"))
    return _median(values.sort(dim=-2).values)


def _median(ordered: Tensor) -> Tensor:
    """The same of values that rise along M; the largest number is no finite one."""
    finite = ordered < torch.finfo(ordered.dtype).max
    found = ordered[..., 0, :]
    for last in range(1, ordered.shape[-2]):  # as many as there are models: quicker than to ask how many are finite
        middle = ordered[..., last // 2, :]
        if last % 2:
            middle = (middle + ordered[..., last // 2 + 1, :]).div_(2)
        found = torch.where(finite[..., last, :], middle, found)
    return found


def best_model(mse: Tensor) -> Tensor:
    """Index of the locally best model (16) for proxies [..., M, N]; on ties the reference wins; [..., N]."""
    agree(mse=(mse, "M N"))
    least, best = mse[..., 0, :], torch.zeros_like(mse[..., 0, :], dtype=torch.int64)
    for index in range(1, mse.shape[-2]):  # argmin over an inner dimension is several times slower
        better = mse[..., index, :] < least
        least, best = torch.where(better, mse[..., index, :], least), best.masked_fill(better, index)
    return best


def best_weights(mse: Tensor) -> Tensor:
    """One for the locally best model (16), zero for the others, for proxies [..., M, N]; the same shape."""
    return torch.zeros_like(mse).scatter_(-2, best_model(mse).unsqueeze(-2), 1.0)


def mix(weights: Tensor, predictions: Tensor) -> Tensor:
    """The mixed reward Σ_j w_j r̂_j (15) of [..., M, N]; [..., N]."""
    agree(weights=(weights, "M N"), predictions=(predictions, "M N"))
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
        return best_weights(mse)


class Stacking(Mixer):
    """One weight a model, everywhere: those that predict held-out labels best (Breiman's stacked regressions).

    min ‖Y − Σ_j w_j Ŷ_j‖² + τ·Var(Y)·‖w‖² over w ≥ 0, Σ w = 1, where Ŷ_j are out-of-bag: from draws which have not
    seen the window. The second term pulls towards equal weights, else the first windows decide all.

    Args:
        prior: τ > 0, in units of the labels' variance: the pull is worth τ labels that every model misses by one
            standard deviation, each in a way of its own.
    """

    needs: ClassVar = {"uncertainty": Bootstrap}
    sees_label_errors: ClassVar = True

    def __init__(self, prior: Positive = 1.0) -> None:
        self.prior = prior

    def weights(self, mse: Tensor, label_errors: Tensor | None = None) -> Tensor:
        """The stacked weights, the same for every cell."""
        assert label_errors is not None
        agree(mse=(mse, "M N"), label_errors=(label_errors, "M M"))
        eye = torch.eye(mse.shape[-2], dtype=label_errors.dtype, device=label_errors.device)
        stacked = stacked_weights(self.prior * eye + label_errors)
        return stacked.to(mse.dtype).unsqueeze(-1).expand_as(mse)


def stacked_weights(errors: Tensor) -> Tensor:
    """w [..., M] that minimise wᵀGw over w ≥ 0, Σ w = 1, for G [..., M, M] symmetric and positive definite.

    The minimum of ½wᵀGw − Σ w over w ≥ 0 is a multiple of it, and with G = LLᵀ that is least squares: ‖Lᵀw − L⁻¹1‖.
    """
    agree(errors=(errors, "M M"))
    trace = errors.diagonal(dim1=-2, dim2=-1).sum(-1)
    rounding = torch.diag_embed((ROUNDING * trace).unsqueeze(-1).expand(errors.shape[:-1]))
    factor = torch.linalg.cholesky(errors + rounding)
    target = torch.linalg.solve_triangular(factor, torch.ones_like(errors[..., :1]), upper=False)
    count = errors.shape[-1]
    matrices, vectors = factor.mT.reshape(-1, count, count).cpu().numpy(), target.reshape(-1, count).cpu().numpy()
    from scipy.optimize import nnls  # half a second, for those that stack

    found = np.stack([nnls(matrix, vector)[0] for matrix, vector in zip(matrices, vectors, strict=True)])
    weights = torch.from_numpy(found / found.sum(-1, keepdims=True))
    return weights.view(errors.shape[:-1]).to(errors.device)

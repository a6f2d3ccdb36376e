"""MSE proxies (9)–(11): how far each model can be trusted at a place, as pure equations."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.shapes import agree
from credit.core.tensors import by_replica


def spread(draws: Tensor, ddof: int = 0) -> Tensor:
    """Variance over draws (10), [R, N] of [R, B, N]; `ddof` as in NumPy."""
    agree(draws=(draws, "R B N"))
    return by_replica(lambda part: _spread(part, ddof), draws)


def _spread(draws: Tensor, ddof: int) -> Tensor:
    gaps = draws - draws.mean(1, keepdim=True)  # torch.var is several times slower here
    return gaps.square_().sum(1) / max(draws.shape[1] - ddof, 1)


def gap(reference: Estimate, surrogate: Estimate) -> Tensor:
    """Δ̂² of a surrogate [R, N]: the mean over common draws of the squared gap (9); without, that of the fits (7)."""
    first, second = reference.draws, surrogate.draws
    agree(reference=(reference.mean, "R N"), surrogate=(surrogate.mean, "R N"))
    if first is None or second is None or not (first.shape[1] and second.shape[1]):
        return (reference.mean - surrogate.mean).square()
    agree(reference=(first, "R B N"), surrogate=(second, "R B N"))
    return by_replica(lambda a, b: (a - b).square_().mean(1), first, second)


def mse_proxies(variance: Tensor, disagreement: Tensor) -> Tensor:
    """MSE̅ of each model [..., M, N]: Var̂ of the reference (10), Var̂ + Δ̂² of each surrogate (11).

    Args:
        variance: [..., M, N], the reference first. disagreement: Δ̂² [..., M−1, N].
    """
    agree(variance=(variance, "M N"), disagreement=(disagreement, "M-1 N"))
    return torch.cat([variance[..., :1, :], variance[..., 1:, :] + disagreement], dim=-2)

"""Ridge regression on moments: paths over λ, held-out errors and signs, as pure equations.

θ(λ) = argmin Σ_i w_i (Y_i − x_iᵀθ)² + λ Σ_j s_j² θ_j², where s_j² is the mean square of column j among the windows
after the intercept is taken out, so that units of columns do not matter, and λ counts windows: what is known beforehand
(that a column does nothing) weighs as much as λ of them. The intercept, the column `free`, is not held back. Where
columns cannot be told apart their effects are as small as they can be: what the data do not say, the fit does not.
"""

from __future__ import annotations

import numpy as np

from credit.logged.moments import Moments
from credit.logged.panel import Floats, Ints

LAMBDAS = np.logspace(-3, 4, 15)  # windows
ROUNDING = 1e-10  # of the largest eigenvalue, below which columns are not told apart


def solutions(moments: Moments, penalties: Floats, free: int | None) -> Floats:
    """θ(λ) [..., L, d] for penalties λ [L], or [..., L] of each fit.

    Args:
        moments: [...]. penalties: λ ≥ 0, in windows. free: the column that is not held back; None for no one.
    """
    own = np.delete(np.arange(moments.xy.shape[-1]), [] if free is None else [free])
    xx, xy = moments.xx[..., own[:, None], own], moments.xy[..., own]
    if free is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            inverse = np.where(moments.xx[..., free, free] > 0, 1 / moments.xx[..., free, free], 0.0)
        along = moments.xx[..., own, free] * inverse[..., None]
        xx = xx - along[..., :, None] * moments.xx[..., free, own][..., None, :]
        xy = xy - along * moments.xy[..., free][..., None]
    weight = np.maximum(moments.weight, 1e-300)[..., None]
    before = np.maximum(moments.xx[..., own, own], 0)
    variance = np.diagonal(xx, axis1=-2, axis2=-1)
    scale = np.sqrt(np.where(variance > ROUNDING * before, variance, 0) / weight)
    safe = np.where(scale > 0, scale, 1)
    live = (scale > 0).astype(float)
    xx = xx / (safe[..., :, None] * safe[..., None, :]) * live[..., :, None] * live[..., None, :]
    values, vectors = np.linalg.eigh(xx)
    values = np.maximum(values, 0)
    told = values > ROUNDING * np.maximum(values[..., -1:], 1e-300)
    along_own = np.where(told, (vectors.swapaxes(-1, -2) @ (xy / safe * live)[..., None])[..., 0], 0.0)
    held = values[..., None, :] + np.asarray(penalties)[..., :, None]
    shrunk = along_own[..., None, :] / np.where(told[..., None, :], held, 1.0)
    inner = (shrunk @ vectors.swapaxes(-1, -2)) / safe[..., None, :]
    theta = np.zeros((*inner.shape[:-1], moments.xy.shape[-1]))
    theta[..., own] = inner
    if free is not None:
        rest = (inner * moments.xx[..., free, own][..., None, :]).sum(-1)
        theta[..., free] = (moments.xy[..., free][..., None] - rest) * inverse[..., None]
    return theta


def held_out(pieces: Moments, folds: list[tuple[Ints, Ints]], penalties: Floats, free: int | None) -> Floats:
    """Σ over folds of the squared error with which labels are predicted that a fit has not seen [..., L].

    Args:
        pieces: moments of pieces of the windows [pieces, ...]. folds: for each the pieces that it is tested on, and
            those that are fitted. penalties: λ [L]. free: as for `solutions`.
    """
    total: Floats = np.zeros(1)
    for tested, fitted in folds:
        theta = solutions(pieces[fitted].sum(0), penalties, free)
        total = total + pieces[tested].sum(0).cost(theta)
    return total


def signed(moments: Moments, penalty: float, free: int | None, signs: Ints) -> Floats:
    """θ [d] of one fit in which columns with a sign +1 have no effect below 0, and with −1 none above.

    Args:
        moments: of one fit. penalty: λ. free: as for `solutions`. signs: +1, −1, or 0 for none [d].
    """
    from scipy.optimize import lsq_linear

    unbound = solutions(moments, np.array([penalty]), free)[0]
    if not (unbound * signs < 0).any():
        return unbound
    own = np.delete(np.arange(len(signs)), [] if free is None else [free])
    weight = max(float(moments.weight), 1e-300)
    first = 0.0 if free is None else moments.xx[own, free] ** 2 / max(float(moments.xx[free, free]), 1e-300)
    held = np.zeros(len(signs))
    held[own] = penalty * np.maximum(moments.xx[own, own] - first, 0) / weight
    values, vectors = np.linalg.eigh(moments.xx + np.diag(held))
    told = values > ROUNDING * values[-1]
    root = np.sqrt(values[told])[:, None] * vectors[:, told].T  # rootᵀroot is the matrix
    target = (vectors[:, told].T @ moments.xy) / np.sqrt(values[told])
    size = np.sqrt(np.maximum(np.diag(moments.xx), 1e-300))
    low, high = np.where(signs > 0, 0, -np.inf), np.where(signs < 0, 0, np.inf)
    return lsq_linear(root / size, target, bounds=(low, high), tol=1e-12).x / size

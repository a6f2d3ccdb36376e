"""Ridge regression on moments: paths over λ, held-out errors and signs, as pure equations.

θ(λ) = argmin Σ_i w_i (Y_i − x_iᵀθ)² + λ Σ_j s_j² θ_j², where s_j² is the mean square of column j among all windows (for
a fit to some of them, too: what these hardly tell must not be held back less) after the intercept is taken out, so that
units of columns do not matter, and λ counts windows: what is known beforehand (that a column does nothing) weighs as
much as λ of them. The intercept, the column `free`, is not held back. Where columns cannot be told apart their effects
are as small as they can be: what the data do not say, the fit does not.
"""

from __future__ import annotations

import numpy as np

from credit.logged.fits.moments import Moments
from credit.logged.panel import NOTHING, Floats, Ints

LAMBDAS = np.logspace(-3, 4, 15)  # windows
ROUNDING = 1e-10  # of the largest eigenvalue, below which columns are not told apart


def solutions(moments: Moments, penalties: Floats, free: int | None, whole: Moments | None = None) -> Floats:
    """θ(λ) [..., L, d] for penalties λ [L], or [..., L] of each fit.

    Args:
        moments: [...]. penalties: λ ≥ 0, in windows. free: the column that is not held back; None for no one.
        whole: of all windows, by which columns are scaled; None: these are all.
    """
    own = np.delete(np.arange(moments.xy.shape[-1]), [] if free is None else [free])
    xx, xy = moments.xx[..., own[:, None], own], moments.xy[..., own]
    if free is not None:
        square = moments.xx[..., free, free]
        inverse = np.where(square > 0, 1 / np.where(square > 0, square, 1), 0.0)
        along = moments.xx[..., own, free] * inverse[..., None]
        xx = xx - along[..., :, None] * moments.xx[..., free, own][..., None, :]
        xy = xy - along * moments.xy[..., free][..., None]
    scale = scales(moments if whole is None else whole, free)[..., own]
    safe = np.where(scale > 0, scale, 1)
    live = (scale > 0).astype(float)
    xx = xx / (safe[..., :, None] * safe[..., None, :]) * live[..., :, None] * live[..., None, :]
    penalties = np.asarray(penalties, dtype=np.float64)
    if penalties.shape[-1] == 1 and (penalties > 0).all():  # one λ: no path is needed, and this is many times faster
        held = xx + penalties[..., None] * np.eye(len(own))
        along_own = np.linalg.solve(held, (xy / safe * live)[..., None])[..., 0]
        return _whole(along_own[..., None, :] / safe[..., None, :], moments, own, free)
    values, vectors = np.linalg.eigh(xx)
    values = np.maximum(values, 0)
    told = values > ROUNDING * np.maximum(values[..., -1:], 1e-300)
    along_own = np.where(told, (vectors.swapaxes(-1, -2) @ (xy / safe * live)[..., None])[..., 0], 0.0)
    held = values[..., None, :] + penalties[..., :, None]
    shrunk = along_own[..., None, :] / np.where(told[..., None, :], held, 1.0)
    return _whole((shrunk @ vectors.swapaxes(-1, -2)) / safe[..., None, :], moments, own, free)


def _whole(inner: Floats, moments: Moments, own: Ints, free: int | None) -> Floats:
    """θ [..., L, d] of its penalised part [..., L, d − 1]: the intercept follows from it."""
    theta = np.zeros((*inner.shape[:-1], moments.xy.shape[-1]))
    theta[..., own] = inner
    if free is not None:
        square = moments.xx[..., free, free]
        rest = (inner * moments.xx[..., free, own][..., None, :]).sum(-1)
        left = moments.xy[..., free][..., None] - rest
        theta[..., free] = np.where(square > 0, 1, 0)[..., None] * left / np.where(square > 0, square, 1)[..., None]
    return theta


def scales(moments: Moments, free: int | None) -> Floats:
    """s of each column [..., d], 0 for the column `free` and for those that do not vary."""
    before = np.diagonal(moments.xx, axis1=-2, axis2=-1)
    variance = before
    if free is not None:
        square = before[..., free, None]
        variance = before - moments.xx[..., free, :] ** 2 / np.where(square > 0, square, np.inf)
    weight = np.maximum(moments.weight, 1e-300)[..., None]
    scale = np.sqrt(np.where(variance > ROUNDING * np.maximum(before, 0), variance, 0) / weight)
    if free is not None:
        scale[..., free] = 0
    return scale


def rounded(theta: Floats, moments: Moments) -> Floats:
    """θ [..., d] of fits with moments [...], 0 where what a column adds to labels is what rounding left."""
    adds = np.abs(theta) * np.sqrt(np.maximum(np.diagonal(moments.xx, axis1=-2, axis2=-1), 0))
    return np.where(adds > NOTHING * np.sqrt(np.maximum(moments.yy, 0))[..., None], theta, 0.0)


def left(y: Floats, fitted: Floats) -> Floats:
    """What is left of labels [W]; 0 where it is what rounding left of them."""
    residuals = y - fitted
    return np.where(np.abs(residuals) > NOTHING * np.nanmax(np.abs(y)), residuals, 0.0)


def held_out(fitted: Moments, tested: Moments, penalties: Floats, free: int | None) -> Floats:
    """Σ over folds of the squared error with which labels are predicted that a fit has not seen [..., L].

    Args:
        fitted, tested: of each fold what it is fitted to, and what it is tested on [K, ...]. penalties: λ [L]. free: as
            for `solutions`.
    """
    return tested.cost(solutions(fitted, penalties, free, fitted + tested)).sum(0)


def signed(moments: Moments, penalty: float, free: int | None, signs: Ints, whole: Moments | None = None) -> Floats:
    """θ [d] of one fit in which columns with a sign +1 have no effect below 0, and with −1 none above.

    Args:
        moments: of one fit. penalty: λ. free, whole: as for `solutions`. signs: +1, −1, or 0 for none [d].
    """
    from scipy.optimize import lsq_linear

    unbound = solutions(moments, np.array([penalty]), free, whole)[0]
    if not (unbound * signs < 0).any():
        return unbound
    held = penalty * scales(moments if whole is None else whole, free) ** 2
    values, vectors = np.linalg.eigh(moments.xx + np.diag(held))
    told = values > ROUNDING * values[-1]
    root = np.sqrt(values[told])[:, None] * vectors[:, told].T  # rootᵀroot is the matrix
    target = (vectors[:, told].T @ moments.xy) / np.sqrt(values[told])
    size = np.sqrt(np.maximum(np.diag(moments.xx), 1e-300))
    low, high = np.where(signs > 0, 0, -np.inf), np.where(signs < 0, 0, np.inf)
    found = lsq_linear(root / size, target, bounds=(low, high), tol=1e-12)
    return np.where(found.active_mask == 0, found.x / size, 0.0)

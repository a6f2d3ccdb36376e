"""What others do of one series, by dense matrices as their papers write it: small, slow, to compare with.

Every function takes labels Y [W], NaN for none, indicators x [n, d] and rows of each window [W], and gives steps [n]. A
column of ones among the indicators is an intercept. Labels are sums, unless `label_is` says mean or last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

Array = NDArray[np.float64]


def sums(steps: NDArray[np.int64], label_is: str = "sum") -> Array:
    """C [W, n], by which steps become labels."""
    matrix = np.zeros((len(steps), int(steps.sum())))
    for w, end in enumerate(np.cumsum(steps)):
        begin = end - steps[w]
        if label_is == "last":
            matrix[w, end - 1] = 1
        else:
            matrix[w, begin:end] = 1 / steps[w] if label_is == "mean" else 1
    return matrix


def autoregression(n: int, rho: float) -> Array:
    """Covariance of a stationary AR(1) whose innovations have variance 1 [n, n]."""
    return rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) / (1 - rho**2)


def differences(n: int) -> Array:
    """D [n, n]: the first row is that of u_1 − 0."""
    return np.eye(n) - np.eye(n, k=-1)


def _integrated(n: int, rho: float) -> Array:
    """Covariance of a sum of an AR(1) that begins at 0, which Litterman (1983) gives u."""
    inner = (np.eye(n) - rho * np.eye(n, k=-1)) @ differences(n)
    return np.linalg.inv(inner.T @ inner)


def generalised(y: Array, x: Array, c: Array, sigma: Array) -> tuple[Array, Array, float]:
    """Steps, θ and the profile log-likelihood of the labels, for errors of steps with covariance σ² sigma."""
    v = c @ sigma @ c.T
    cx = c @ x
    inverse = np.linalg.inv(v)
    theta = np.linalg.solve(cx.T @ inverse @ cx, cx.T @ inverse @ y)
    left = y - cx @ theta
    cost = left @ inverse @ left
    likelihood = -0.5 * (len(y) * (np.log(2 * np.pi * cost / len(y)) + 1) + np.linalg.slogdet(v)[1])
    return x @ theta + sigma @ c.T @ inverse @ left, theta, likelihood


def _by(family: object, y: Array, x: Array, steps: NDArray[np.int64], rho: float | None, label_is: str) -> Array:
    known = np.isfinite(y)
    c = sums(steps, label_is)[known]
    if rho is None:
        at = lambda rho: -generalised(y[known], x, c, family(len(x), rho))[2]  # type: ignore[operator]  # noqa: E731
        grid = np.append(np.arange(0, 1, 0.05), 0.999)
        best = int(np.argmin([at(each) for each in grid]))
        bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        rho = float(minimize_scalar(at, bounds=bounds, method="bounded", options={"xatol": 1e-7}).x)
    return generalised(y[known], x, c, family(len(x), rho))[0]  # type: ignore[operator]


def chow_lin(y: Array, x: Array, steps: NDArray[np.int64], rho: float | None = None, label_is: str = "sum") -> Array:
    """Chow and Lin (1971), ρ by maximum likelihood where none is given."""
    return _by(autoregression, y, x, steps, rho, label_is)


def litterman(y: Array, x: Array, steps: NDArray[np.int64], rho: float | None = None, label_is: str = "sum") -> Array:
    """Litterman (1983): differences of errors are an AR(1)."""
    return _by(_integrated, y, x, steps, rho, label_is)


def fernandez(y: Array, x: Array, steps: NDArray[np.int64], label_is: str = "sum") -> Array:
    """Fernández (1981): errors are a random walk."""
    return litterman(y, x, steps, 0.0, label_is)


def denton(
    y: Array, indicator: Array, steps: NDArray[np.int64], label_is: str = "sum", proportional: bool = False
) -> Array:
    """Denton (1971) as Cholette (1984) put it right: nothing is said of the first step.

    argmin Σ_{t>1} (Δ (s_t − p_t))², or of Δ (s_t / p_t), under C s = Y, where p is one series [n].
    """
    known = np.isfinite(y)
    c, n = sums(steps, label_is)[known], len(indicator)
    d = differences(n)[1:]
    if proportional:
        d = d / indicator
    target = np.zeros(n) if proportional else d.T @ d @ indicator
    system = np.block([[d.T @ d, c.T], [c, np.zeros((len(c), len(c)))]])
    return np.linalg.lstsq(system, np.concatenate([target, y[known]]), rcond=None)[0][:n]


def uniform(y: Array, steps: NDArray[np.int64], label_is: str = "sum") -> Array:
    """All steps of a window alike."""
    return np.repeat(y / steps if label_is == "sum" else y, steps)

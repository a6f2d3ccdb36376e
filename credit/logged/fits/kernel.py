"""The mixture of rows as a loop: what `mixture` does with the paper's mixer, row by row, so that all stays near.

For ten million rows and two hundred draws the tensor operations of `mixture.of_tensors` move hundreds of gigabytes.
They stay, for other mixers and to compare with. `NUMBA_DISABLE_JIT=1` switches the loop off.
"""

from __future__ import annotations

import numpy as np

from credit.logged.panel import Floats

Rows = tuple[Floats, Floats, Floats, Floats, Floats]


def relative_mse_rows(
    p: Floats, alpha: float, epsilon: float, draws: Floats | None = None, beyond: Floats | None = None
) -> Rows:
    """Mix predictions by relative MSE (14), every draw by weights of its own.

    Args:
        p: predictions [M, n, 1 + B], the point fit first, B ≥ 1. alpha, epsilon: of the mixer.
        draws: filled with those of the mixture [n, B]. beyond: what variances are larger than those of draws [M, n].

    Returns:
        Credit [n], its deviation over draws [n], weights [M, n], proxies [M, n], Δ̂² [M − 1, n].
    """
    models, rows = p.shape[:2]
    found = (np.empty(rows), np.empty(rows), np.empty((models, rows)), np.empty((models, rows)))
    between = np.empty((models - 1, rows))
    kept = np.empty((0, p.shape[2] - 1)) if draws is None else draws
    more = np.zeros((models, rows)) if beyond is None else beyond
    from credit.logged.fits import loops  # which takes half a second

    loops.rows(p, alpha, epsilon, more, *found, between, kept)
    return *found, between

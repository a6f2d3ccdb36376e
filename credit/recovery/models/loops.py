"""Recursive least squares as a loop: what `LinearModel` does by tensor operations, one fit after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from credit.core.compiled import Loop

Numbers = NDArray[np.float64]


@Loop
def sherman_morrison(
    inverse: Numbers, theta: Numbers, cost: Numbers, sums: Numbers, labels: Numbers, weights: Numbers
) -> None:
    """One window after the other into every fit, in place.

    A fit in which a window counts nothing is left alone (with Poisson weights more than a third), and of V⁻¹x only the
    rows of V⁻¹ are read, which is symmetric and stays so, where x is not zero.

    Args:
        inverse: V⁻¹ [R, F, d, d]. theta: θ [R, F, d]. cost: of the first fit [R]. sums: x [R, k, d].
        labels: Y [R, k]. weights: [R, k, F].
    """
    replicas, fits, size = theta.shape
    u = np.empty(size)
    for r in range(replicas):
        for k in range(labels.shape[1]):
            x = sums[r, k]
            used = np.nonzero(x)[0]
            for f in range(fits):
                weight, v = weights[r, k, f], inverse[r, f]
                if weight == 0:
                    continue
                u[:] = 0
                error = labels[r, k]
                for n in used:
                    error -= theta[r, f, n] * x[n]
                    for j in range(size):
                        u[j] += x[n] * v[n, j]
                scale = 1.0
                for n in used:
                    scale += weight * u[n] * x[n]
                if f == 0:
                    cost[r] += weight * error * error / scale
                u *= np.sqrt(weight / scale)
                error *= np.sqrt(weight / scale)
                for i in range(size):
                    theta[r, f, i] += u[i] * error
                    for j in range(size):
                        v[i, j] -= u[i] * u[j]

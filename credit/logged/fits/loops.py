"""The loop of `kernel`, compiled when it is first called, and kept for other processes beside this file.

A function that is kept must stand in a module, with all that it calls: each process compiles what stands in another
function anew.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from credit.core.kept import kept


@partial(kept, nogil=True)
def weigh(mse: Any, weight: Any, order: Any, alpha: Any, epsilon: Any) -> None:
    """Equations (12)–(14) for the finite proxies [M] of one place."""
    models = len(mse)
    for j in range(models):  # a few: sorted by insertion
        k = j
        while k > 0 and order[k - 1] > mse[j]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = mse[j]
    scale = alpha * max((order[(models - 1) // 2] + order[models // 2]) / 2, epsilon)
    total = 0.0
    for j in range(models):
        weight[j] = np.exp((order[0] - mse[j]) / scale)
        total += weight[j]
    for j in range(models):
        weight[j] /= total


@partial(kept, nogil=True)
def rows(
    p: Any,
    alpha: Any,
    epsilon: Any,
    beyond: Any,
    credit: Any,
    deviation: Any,
    weights: Any,
    mse: Any,
    between: Any,
    kept: Any,
) -> None:
    """Fill what `kernel.relative_mse_rows` returns."""
    models, count, fits = p.shape
    draws = fits - 1
    variance, gap_variance = np.empty(models), np.empty(models)
    own, weight, order, mixed = np.empty(models), np.empty(models), np.empty(models), np.empty(draws)
    for i in range(count):
        for j in range(models):
            mean = 0.0
            for b in range(1, fits):
                mean += p[j, i, b]
            mean /= draws
            total = 0.0
            for b in range(1, fits):
                total += (p[j, i, b] - mean) ** 2
            variance[j] = total / draws + beyond[j, i]
            mse[j, i] = variance[j]
            gap_variance[j] = 0.0
            if j > 0:
                first, second = 0.0, 0.0
                for b in range(1, fits):
                    gap = p[0, i, b] - p[j, i, b]
                    first += gap
                    second += gap * gap
                between[j - 1, i] = second / draws
                mse[j, i] += second / draws
                gap_variance[j] = max(second / draws - (first / draws) ** 2, 0.0)
        for j in range(models):
            own[j] = mse[j, i]
        weigh(own, weight, order, alpha, epsilon)
        credit[i] = 0.0
        for j in range(models):
            weights[j, i] = weight[j]
            credit[i] += weight[j] * p[j, i, 0]
        mean = 0.0
        for b in range(draws):
            own[0] = variance[0]
            for j in range(1, models):
                gap = p[0, i, b + 1] - p[j, i, b + 1]
                own[j] = variance[j] + gap * gap + gap_variance[j]
            weigh(own, weight, order, alpha, epsilon)
            total = 0.0
            for j in range(models):
                total += weight[j] * p[j, i, b + 1]
            mixed[b] = total
            mean += total
        mean /= draws
        total = 0.0
        for b in range(draws):
            total += (mixed[b] - mean) ** 2
        deviation[i] = np.sqrt(total / draws)
        if len(kept):
            kept[i] = mixed

"""Sums of products over windows: all that a linear fit needs to know, in one pass, of every fold and every draw.

Moments of disjoint sets of windows add up, so that parts, shards and folds are fitted together or apart by addition.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from credit.logged.panel import Floats, Ints

NUMBERS = 4_000_000  # products that are made at a time: what stays near the processor
FEW = 4  # windows of a unit, on the average, from which on their products are added up by one matrix product


@dataclass(frozen=True)
class Moments:
    """Weighted sums over windows, of any number of fits [...].

    Attributes:
        xx: Σ w x xᵀ [..., d, d]. xy: Σ w x Y [..., d]. yy: Σ w Y² [...]. weight: Σ w [...].
    """

    xx: Floats
    xy: Floats
    yy: Floats
    weight: Floats

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy, self.weight + other.weight)

    def __sub__(self, other: Moments) -> Moments:
        return Moments(self.xx - other.xx, self.xy - other.xy, self.yy - other.yy, self.weight - other.weight)

    def __getitem__(self, at: Any) -> Moments:
        return Moments(self.xx[at], self.xy[at], self.yy[at], self.weight[at])

    def sum(self, axis: int) -> Moments:
        """Of several sets together; `axis` counts from the front."""
        return Moments(self.xx.sum(axis), self.xy.sum(axis), self.yy.sum(axis), self.weight.sum(axis))

    def of(self, columns: Ints, fits: Ints | None = None) -> Moments:
        """With some columns of the design alone [d]; or with several choices of as many [C, d], which come last.

        Args:
            columns: of the design. fits: some of the second dimension, where one choice is made; None: all.
        """
        if fits is not None:
            inner = (slice(None), fits[:, None, None], columns[:, None], columns)
            xy = self.xy[:, fits[:, None], columns]
            return Moments(self.xx[inner], xy, self.yy[:, fits], self.weight[:, fits])
        if columns.ndim == 1:
            return Moments(self.xx[..., columns[:, None], columns], self.xy[..., columns], self.yy, self.weight)
        xx = self.xx[..., columns[:, :, None], columns[:, None, :]]
        return Moments(xx, self.xy[..., columns], self.yy[..., None], self.weight[..., None])

    def cost(self, theta: Floats) -> Floats:
        """Σ w (Y − xᵀθ)² [..., L] of coefficients [..., L, d]."""
        square = ((theta @ self.xx) * theta).sum(-1)
        return self.yy[..., None] - 2 * (theta @ self.xy[..., None])[..., 0] + square


def moments(
    x: Floats, y: Floats, piece: Ints, unit: Ints, weights: Callable[[Ints], Floats], pieces: int, fits: int
) -> Moments:
    """Moments of every piece of the windows in every fit.

    Args:
        x: [W, d]. y: Y [W]. piece: which piece a window is in, 0 to pieces − 1 [W]. unit: what is weighted as one [W].
        weights: units [u] → how much each counts in each fit [u, F]. pieces: how many. fits: F.

    Returns:
        Of pieces and fits, [pieces, F, ...].
    """
    count, size = x.shape
    whole = size + 1
    rows, columns = np.triu_indices(whole)
    order = np.lexsort((unit, piece))
    which, own = piece[order], unit[order]
    begins = np.flatnonzero(np.diff(which, prepend=-1) | np.diff(own, prepend=own[:1] - 1))
    together = count > FEW * len(begins)  # many windows are weighted as one
    total = np.zeros((pieces, len(rows) + 1, fits))
    at_once = max(1, NUMBERS // (len(rows) + 1))
    every = begins if together else np.arange(count)
    ends = np.append(every, count)
    for first in range(0, len(every), at_once):
        bounds = ends[first : first + at_once + 1]
        chosen = order[bounds[0] : bounds[-1]]
        both = np.concatenate([x[chosen], y[chosen, None]], axis=1)
        products = np.empty((len(rows) + 1, len(bounds) - 1))
        if together:
            for number, (begin, end) in enumerate(pairwise(bounds - bounds[0])):
                products[:-1, number] = (both[begin:end].T @ both[begin:end])[rows, columns]
            products[-1] = np.diff(bounds)
        else:
            across = np.ascontiguousarray(both.T)
            np.multiply(across[rows], across[columns], out=products[:-1])
            products[-1] = 1
        edges = np.searchsorted(which[bounds[:-1]], np.arange(pieces + 1))
        for number, (begin, end) in enumerate(pairwise(edges)):
            if begin < end:
                total[number] += products[:, begin:end] @ weights(own[bounds[begin:end]])
    square = np.empty((pieces, fits, whole, whole))
    square[:, :, rows, columns] = square[:, :, columns, rows] = total[:, :-1].swapaxes(1, 2)
    return Moments(square[..., :-1, :-1], square[..., :-1, -1], square[..., -1, -1], total[:, -1])

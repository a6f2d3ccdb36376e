"""Errors of many candidates, each with a few columns of its own beside many that are always there.

The columns that are always there are taken out once (a Schur complement), so that a candidate costs a system as large
as what it adds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from credit.logged.fits.moments import Moments
from credit.logged.fits.ridge import scales
from credit.logged.panel import Floats, Ints


@dataclass(frozen=True)
class Reduced:
    """What is left of a ridge fit and of its errors when columns that are always there are taken out, of K folds.

    Attributes:
        place: where a column of the design is among those that are left, −1 for others [D].
        xx, xy: of the fits [K, C, C], [K, C], with λ on the diagonal. inside, along, rest: squared errors on what is
            tested as a function of θ of what is left, θᵀ inside θ − 2 θᵀ along + rest [K, C, C], [K, C], [K].
    """

    place: Ints
    xx: Floats
    xy: Floats
    inside: Floats
    along: Floats
    rest: Floats

    @classmethod
    def of(cls, fitted: Moments, tested: Moments, always: Ints, penalty: float, free: int | None) -> Reduced:
        """Take columns out.

        Args:
            fitted, tested: of each fold [K, ...]. always: columns that every candidate has, `free` among them.
            penalty: λ > 0. free: the column that is not held back.
        """
        size = fitted.xy.shape[-1]
        left = np.setdiff1d(np.arange(size), always)
        place = np.full(size, -1, dtype=np.int64)
        place[left] = np.arange(len(left))
        scale = scales(fitted + tested, free)
        dead = scale == 0  # a column that does not vary has no effect
        if free is not None:
            dead[:, free] = fitted.xx[:, free, free] == 0
        live = (~dead).astype(float)
        xx = fitted.xx * live[:, :, None] * live[:, None, :]
        at = np.arange(size)
        xx[:, at, at] += penalty * scale**2 + dead
        xy = fitted.xy * live
        f, c = always, left
        unit = np.sqrt(xx[:, f, f])
        both = np.concatenate([xx[:, f[:, None], c], xy[:, f, None]], axis=2)
        inner = xx[:, f[:, None], f] / (unit[:, :, None] * unit[:, None, :])
        out = np.linalg.solve(inner, both / unit[:, :, None]) / unit[:, :, None]
        by, base = out[..., :-1], out[..., -1]
        across = xx[:, c[:, None], f]
        test_ff, test_cf = tested.xx[:, f[:, None], f], tested.xx[:, c[:, None], f]
        turned = by.swapaxes(1, 2)
        mixed = test_cf - turned @ test_ff  # of what is left, with what was taken out
        return cls(
            place,
            xx[:, c[:, None], c] - across @ by,
            xy[:, c] - (across @ base[..., None])[..., 0],
            tested.xx[:, c[:, None], c] - mixed @ by - turned @ test_cf.swapaxes(1, 2),
            tested.xy[:, c] - (turned @ tested.xy[:, f, None] + mixed @ base[..., None])[..., 0],
            tested.yy + (base * ((test_ff @ base[..., None])[..., 0] - 2 * tested.xy[:, f])).sum(-1),
        )

    def errors(self, candidates: Ints) -> Floats:
        """Σ over folds of squared errors of what is tested [C], of candidates with as many columns each [C, k]."""
        own = self.place[candidates]
        rows, columns = own[:, :, None], own[:, None, :]
        theta = np.linalg.solve(self.xx[:, rows, columns], self.xy[:, own, None])[..., 0]
        squares = ((self.inside[:, rows, columns] @ theta[..., None])[..., 0] - 2 * self.along[:, own]) * theta
        return (squares.sum(-1) + self.rest[:, None]).sum(0)

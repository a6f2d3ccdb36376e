"""Contiguous folds with a gap: what is tested lies apart in time from what was fitted, never between it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from credit.logged.fits.moments import Moments
from credit.logged.panel import NOTHING, Floats, Ints, Windows


@dataclass(frozen=True)
class Folds:
    """Times are cut into K stretches, and each into its first, middle and last windows: pieces, [3K].

    Attributes:
        piece: of each window [W]: 3 fold + 0, 1, 2. of: for each fold the pieces that it is tested on, and those that
            are fitted: all of the others, but not those that touch it. gap: times that are left out at each border.
    """

    piece: Ints
    of: list[tuple[Ints, Ints]]
    gap: int

    @property
    def fold(self) -> Ints:
        """Which fold tests a window [W]."""
        return self.piece // 3

    def apart(self, pieces: Moments) -> tuple[Moments, Moments]:
        """Moments of pieces [3K, ...] as what each fold is fitted to, and what it is tested on [K, ...]."""
        tested, fitted = zip(*self.of, strict=True)
        return self._summed(pieces, fitted), self._summed(pieces, tested)

    def _summed(self, pieces: Moments, several: Iterable[Ints]) -> Moments:
        """Of several sets of pieces [K, ...], by one product of matrices."""
        inside = np.array([np.isin(np.arange(self.pieces), which) for which in several], dtype=np.float64)
        parts = (pieces.xx, pieces.xy, pieces.yy, pieces.weight)
        return Moments(*(np.tensordot(inside, part, axes=1) for part in parts))

    @property
    def pieces(self) -> int:
        """3K."""
        return 3 * len(self.of)


def folds_of(windows: Windows, count: int, gap: int) -> Folds:
    """K folds of windows, cut where labelled windows are equally many.

    Args:
        windows: in groups and times. count: K, at most; there are not more than half of the times with labels.
        gap: times before and after a fold in which nothing is fitted; a third of a fold at most.
    """
    times = np.unique(windows.time[windows.labelled])
    count = max(1, min(count, len(times) // 2))
    gap = min(gap, max(len(times) // count // 3, 0))
    edges = times[np.linspace(0, len(times), count + 1).astype(int)[1:-1]] if count > 1 else times[:0]
    fold = np.searchsorted(edges, windows.time, side="right")
    begins = np.concatenate([[windows.time.min()], edges])
    ends = np.concatenate([edges, [windows.time.max() + 1]])
    head = windows.time < begins[fold] + gap
    tail = windows.time >= ends[fold] - gap
    piece = 3 * fold + np.where(head, 0, np.where(tail, 2, 1))
    every = np.arange(3 * count)
    of = []
    for k in range(count):
        away = (every // 3 != k) & (every != 3 * k - 1) & (every != 3 * k + 3)
        of.append((every[every // 3 == k], every[away]))
    return Folds(piece.astype(np.int64), of, gap)


def r_squared(labels: Floats, predicted: Floats, plain: Floats) -> float:
    """1 − Σ (Y − Ŷ)² / Σ (Y − Y₀)² over windows where all three are known; NaN where the plain one makes no error."""
    known = np.isfinite(labels) & np.isfinite(predicted) & np.isfinite(plain)
    below = ((labels - plain)[known] ** 2).sum()
    nothing = (NOTHING * labels[known]) ** 2
    return float(1 - ((labels - predicted)[known] ** 2).sum() / below) if below > nothing.sum() else float("nan")

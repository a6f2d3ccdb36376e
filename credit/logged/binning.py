"""Rows by what a feature is in them: each category, or thirds of its numbers, as equal as ties allow.

A third is called by the numbers that are really in it: a feature that is 0 or 1 has two, "0" and "1".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from credit.logged.panel import Column, Floats

if TYPE_CHECKING:
    import pandas as pd

BINS = 3  # of a number


@dataclass
class Bin:
    """Rows that were added up.

    Attributes:
        sums: of each, the first is their number. low, high: the least and the most of a number's values in it.
    """

    sums: Floats
    low: float = np.inf
    high: float = -np.inf

    def add(self, other: Bin) -> Bin:
        """Both."""
        return Bin(self.sums + other.sums, min(self.low, other.low), max(self.high, other.high))


Bins = dict[tuple[str, int], Bin]  # feature and number of the bin


def edges(column: Column) -> Floats:
    """Up to which number each third of a feature goes, but the last: what one value alone has is not cut."""
    quantiles = np.array(column.quantiles)
    grid = np.linspace(0, 1, len(quantiles))
    found, below = list[float](), 0.0
    for left in range(BINS, 1, -1):
        edge = float(np.interp(below + (1 - below) / left, grid, quantiles))
        if edge >= quantiles[-1]:  # the rest is its largest value, mostly
            found += quantiles[quantiles < quantiles[-1]][-1:].tolist()
            break
        found.append(edge)
        below = max(below + (1 - below) / left, float(grid[quantiles <= edge][-1]))
    return np.unique(found)


def binned(series: pd.Series, column: Column) -> Iterator[tuple[int, np.ndarray, Bin]]:
    """Which rows [n] are in each bin that has some, and a bin of their number alone."""
    if column.levels is not None:
        codes = series.cat.codes.to_numpy()
        for number in np.unique(codes[codes >= 0]):
            held = codes == number
            yield int(number), held, Bin(np.array([float(held.sum())]))
        return
    values = series.to_numpy(np.float64)
    which = np.searchsorted(edges(column), values, side="left")
    for number in np.unique(which):
        held = which == number
        yield (
            int(number),
            held,
            Bin(np.array([float(held.sum())]), float(values[held].min()), float(values[held].max())),
        )


def name(column: Column, number: int, one: Bin) -> str:
    """What a bin is called: a category, a number, or from which to which number it goes."""
    if column.levels is not None:
        return str(column.levels[number])
    low, high = f"{one.low:.4g}", f"{one.high:.4g}"
    return low if low == high else f"{low} to {high}"

"""Small tables, and parts of them, for tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from credit.logged.panel import Column, Part, Roles

N = 21  # rows: the quantiles of their columns are their values, so that what is learned of them is exact
GROUPS = np.repeat([0, 1, 2], [10, 4, 7])


def table() -> pd.DataFrame:
    """Features of every kind."""
    random = np.random.default_rng(5)
    tv = random.permutation(np.linspace(0, 100, N) ** 1.5).round(2)
    return pd.DataFrame(
        {
            "tv": tv,
            "radio": random.gamma(2, 3, N),
            "price": random.uniform(1, 4, N),
            "day": random.permutation(N).astype(float),
            "size of it": random.normal(size=N),
            "region": pd.Categorical(["b", "a", "c"] * 7, categories=["a", "b", "c"]),
            "open": pd.Categorical([True, False, True] * 7),
        }
    )


def columns(frame: pd.DataFrame, stock: Sequence[str] = ()) -> dict[str, Column]:
    """What all rows say of its columns."""
    return {str(name): _column(frame[name], str(name) in stock) for name in frame}


def _column(series: pd.Series[Any], stock: bool) -> Column:
    if isinstance(series.dtype, pd.CategoricalDtype):
        return Column(str(series.name), levels=tuple(series.cat.categories), stock=stock)
    quantiles = tuple(np.quantile(series, np.linspace(0, 1, 21)).tolist())
    moments = (series.mean(), series.std(ddof=1), series.min(), series.max())
    return Column(str(series.name), None, stock, *map(float, moments), quantiles)


def parts(frame: pd.DataFrame, cuts: Sequence[int] = (0, N), groups: Any = GROUPS) -> Iterator[Part]:
    """Its rows from cut to cut, a window each."""
    groups = groups[: len(frame)]
    for first, last in pairwise(cuts):
        continues = first > 0 and groups[first] == groups[first - 1]
        yield Part(frame.iloc[first:last], np.full(last - first, first), groups[first:last], bool(continues))


def part(frame: pd.DataFrame) -> Part:
    """All of its rows."""
    return next(parts(frame, (0, len(frame))))


ROLES = Roles("week", "sales", "date", actions=("tv", "radio"), states=("price", "day", "size of it", "region", "open"))

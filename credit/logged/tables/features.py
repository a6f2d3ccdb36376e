"""Chunks of a table made into features, and what all chunks together say of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Column, Floats, Ints
from credit.logged.tables.clock import CALENDAR, Clock, calendar
from credit.logged.tables.columns import Kind, Levels, Moments, codes, numbers, spread_out
from credit.logged.tables.keys import texts
from credit.logged.tables.words import Missing

if TYPE_CHECKING:
    import pandas as pd

QUANTILES = 250_000  # rows, spread over all, whose quantiles are taken


class Features:
    """How features are read.

    Args:
        kinds: of each feature. dates: feature → what of a date it is. clock: of the column of these dates.
        missing: what is done where a feature has no value. source: for messages.
    """

    def __init__(
        self,
        kinds: Mapping[str, Kind],
        dates: Mapping[str, str],
        clock: Clock | None,
        missing: Missing,
        source: str,
    ) -> None:
        self.kinds, self._dates, self._clock = kinds, dates, clock
        self.missing, self._source = missing, source
        self.columns: Mapping[str, Column] = {}

    @property
    def needed(self) -> list[str]:
        """Columns of the table that they are made of."""
        own = [name for name in self.kinds if name not in self._dates]
        return own + ([self._clock.column] if self._dates and self._clock and self._clock.column not in own else [])

    def made(self, frame: pd.DataFrame, rows: Ints) -> dict[str, Floats | pd.Series[Any]]:
        """Features of some rows: numbers with NaN for none, and categories as they were.

        Raises:
            UserError: a value that is none, with its row.
        """
        import pandas as pd

        found: dict[str, Floats | pd.Series[Any]] = {}
        dates: Any = None
        if self._dates and self._clock:
            dates = self._clock.dates(frame[self._clock.column], rows, self._source)
        for name, kind in self.kinds.items():
            if name in self._dates:
                values, levels = calendar(self._dates[name], dates), CALENDAR[self._dates[name]]
                if levels is None:
                    found[name] = values
                else:
                    found[name] = pd.Series(
                        pd.Categorical.from_codes(values.astype(np.int64), categories=pd.Index(levels)), name=name
                    )
            elif kind == "number":
                found[name] = numbers(frame[name], rows, self._source)
            else:
                found[name] = frame[name]
        return found

    def gaps(self, made: Mapping[str, Any], length: int) -> NDArray[np.bool_]:
        """Which rows lack a feature [n]."""
        import pandas as pd

        found = np.zeros(length, dtype=bool)
        for values in made.values():
            found |= np.isnan(values) if isinstance(values, np.ndarray) else pd.isna(values).to_numpy()
        return found

    def filled(self, made: Mapping[str, Any]) -> dict[str, Any]:
        """The same with means, or most frequent levels, where there was none; categories with all levels there are."""
        import pandas as pd

        found: dict[str, Any] = {}
        for name, values in made.items():
            column = self.columns[name]
            if column.levels is None:
                gaps = np.isnan(values)
                found[name] = np.where(gaps, column.mean, values) if gaps.any() else values
                continue
            code = level_codes(values, column.levels)
            if (code < 0).any():
                code = np.where(code < 0, column.levels.index(column.frequent), code)
            found[name] = pd.Categorical.from_codes(code, categories=pd.Index([*column.levels]))
        return found


def level_codes(values: pd.Series[Any], levels: tuple[Any, ...]) -> Ints:
    """Which of a category's levels values are [n]: those that are equal, or else written alike; −1 for none."""
    found, own = codes(values)
    place = {level: at for at, level in enumerate(levels)}
    at = [place.get(level, -1) for level in own.tolist()]
    if -1 in at:
        written = dict(zip(texts(np.array(levels, dtype=object)).tolist(), range(len(levels)), strict=True))
        at = [written.get(text, -1) if code < 0 else code for code, text in zip(at, texts(own).tolist(), strict=True)]
    return np.array([*at, -1], dtype=np.int64)[found]


class Gaps:
    """Which values are missing, as chunks of rows come by, and what is done about it.

    Attributes:
        gaps: feature → rows without a value.

    Args:
        features: how they are read.
    """

    def __init__(self, features: Features) -> None:
        self._features, self._seen = features, 0
        self.gaps: dict[str, int] = dict.fromkeys(features.kinds, 0)
        self._first: dict[str, int] = {}

    def kept(self, made: Mapping[str, Any], rows: Ints) -> NDArray[np.bool_]:
        """Look at the features of some rows; which of them stay [n]."""
        import pandas as pd

        keep = np.ones(len(rows), dtype=bool)
        for name, values in made.items():
            gone = np.isnan(values) if isinstance(values, np.ndarray) else pd.isna(values).to_numpy()
            if gone.any():
                self.gaps[name] += int(gone.sum())
                self._first.setdefault(name, int(rows[gone.argmax()]))
                if self._features.missing == "drop":
                    keep &= ~gone
        self._seen += len(rows)
        return keep

    def add(self, frame: pd.DataFrame, rows: Ints, source: str) -> NDArray[np.bool_]:
        """Look at some rows; which of them stay [n].

        Raises:
            UserError: a value that is none.
        """
        return self.kept(self._features.made(frame, rows), rows)

    def complete(self, source: str) -> None:
        """Refuse features without values, where no remedy was asked for.

        Raises:
            UserError: with how many rows of each column.
        """
        lacking = {name: count for name, count in self.gaps.items() if count}
        if lacking and self._features.missing == "error":
            counts = ", ".join(f"{name} {count}" for name, count in lacking.items())
            first = next(iter(lacking))
            raise UserError(
                f"{source}: values are missing (rows without one: {counts}; the first is {first} of row "
                f"{self._first[first]}); fill them in, or say data.missing=mean (the column's mean) or "
                "data.missing=drop (without these rows)"
            )


class Survey(Gaps):
    """What rows say of features, chunk by chunk.

    Args:
        features: how they are read. stock: those that are levels. rows: how many there are in all.
    """

    def __init__(self, features: Features, stock: Sequence[str], rows: int, orders: Mapping[str, Any]) -> None:
        super().__init__(features)
        self._stock, self._rows = stock, rows
        self.moments = {name: Moments() for name, kind in features.kinds.items() if kind == "number"}
        self.levels = {name: Levels(name, orders.get(name)) for name in features.kinds if name not in self.moments}
        self._some: dict[str, list[Floats]] = {name: [] for name in self.moments}

    def add(self, frame: pd.DataFrame, rows: Ints, source: str) -> NDArray[np.bool_]:
        """Look at some rows; which of them stay [n].

        Raises:
            UserError: a value that is none.
        """
        made = self._features.made(frame, rows)
        first = self._seen
        keep = self.kept(made, rows)
        everything = bool(keep.all())
        some = spread_out(first, len(rows), self._rows, QUANTILES) & keep
        for name, values in made.items():
            if name in self.moments:
                numbers_of = np.asarray(values)
                self.moments[name].add(numbers_of if everything else numbers_of[keep])
                self._some[name].append(numbers_of[some])
            else:
                series: Any = values
                self.levels[name].add(series if everything else series[keep], rows[keep], source)
        return keep

    def complete(self, source: str) -> None:
        """Refuse features without values, where no remedy was asked for.

        Raises:
            UserError: with how many rows of each column.
        """
        for name, count in self.gaps.items():
            if count == self._seen:
                raise UserError(f"{source}: {name} has no value in any row; leave it out")
        super().complete(source)
        for levels in self.levels.values():
            levels.alike(source)

    def columns(self) -> dict[str, Column]:
        """What all rows said; quantiles of more than a quarter of a million rows are those of so many of them."""
        found = {}
        for name in self._features.kinds:
            stock = name in self._stock
            if name in self.levels:
                levels = self.levels[name]
                found[name] = Column(name, levels.ordered(), stock, frequent=levels.frequent())
                continue
            seen, some = self.moments[name], np.concatenate(self._some[name])
            some = some[~np.isnan(some)]
            at = np.quantile(some, np.linspace(0, 1, 21)) if len(some) else np.full(21, seen.mean)
            at[0], at[-1] = seen.least, seen.most
            found[name] = Column(
                name, None, stock, seen.mean, seen.deviation, seen.least, seen.most, tuple(at.tolist())
            )
        return found

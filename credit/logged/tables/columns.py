"""Columns of a table as features: their kinds, and numbers and categories out of what was logged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Floats, Ints

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["number", "category", "date", "empty", "other"]
LEVELS = 200  # of a category; with more, one number for each would say little of any
BLOCK = 32_768  # numbers that stay in a processor's cache while they are looked at


def kind(values: pd.Series[Any]) -> Kind:
    """What a column holds, judged by some of its rows."""
    import pandas as pd

    if isinstance(values.dtype, pd.CategoricalDtype):
        return "category"
    if not len(values.dropna()):
        return "empty"
    if values.dtype.kind == "M" or isinstance(values.dtype, pd.PeriodDtype):
        return "date"
    if values.dtype.kind in "iufb":
        return "number"
    if isinstance(values.dtype, pd.StringDtype):
        return "category"
    inferred = pd.api.types.infer_dtype(values, skipna=True)
    if inferred in ("integer", "floating", "mixed-integer-float", "decimal", "boolean"):
        return "number"
    if inferred in ("date", "datetime", "datetime64"):
        return "date"
    return "category" if inferred in ("string", "mixed-integer", "mixed") and _plain(values) else "other"


def _plain(values: pd.Series[Any]) -> bool:
    return all(isinstance(value, str | int | float | bool) for value in values.dropna().iloc[:1000])


def numbers(values: pd.Series[Any], rows: Ints, source: str, what: str = "a feature") -> Floats:
    """Numbers [n], NaN where there is none.

    Args:
        rows: the rows' numbers, for messages. what: what it is used as, for messages.

    Raises:
        UserError: a value that is no number, or infinite.
    """
    import pandas as pd

    if values.dtype.kind in "iufb" and not isinstance(values.dtype, pd.CategoricalDtype):
        found = values.to_numpy(dtype=np.float64, na_value=np.nan)
    else:
        plain = values.astype(object) if isinstance(values.dtype, pd.CategoricalDtype) else values
        found = pd.to_numeric(plain, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
        bad = np.isnan(found) & values.notna().to_numpy()
        if bad.any():
            at = int(bad.argmax())
            raise UserError(
                f"{source}: {values.name} of row {rows[at]} is {values.iloc[at]!r}, and it is {what}, which must be a "
                "number; mend it, or leave it empty"
            )
    if np.isinf(found).any():
        at = int(np.isinf(found).argmax())
        raise UserError(f"{source}: {values.name} of row {rows[at]} is {found[at]}; it must be finite")
    return found


def codes(values: pd.Series[Any]) -> tuple[Ints, NDArray[Any]]:
    """Numbers of levels [n], −1 where there is none, and the levels in the order in which they come."""
    import pandas as pd

    if isinstance(values.dtype, pd.CategoricalDtype):
        found, levels = pd.factorize(values.cat.codes.to_numpy(), use_na_sentinel=False)
        names = np.asarray(values.cat.categories, dtype=object)
        good = levels >= 0
        renumbered = np.where(good, np.cumsum(good) - 1, -1)[found]
        return renumbered.astype(np.int64), names[levels[good]]
    found, uniques = pd.factorize(values)
    return found.astype(np.int64), np.asarray(uniques, dtype=None if values.dtype in (np.int64, np.float64) else object)


class Levels:
    """The levels of a category, as chunks of rows come by.

    Args:
        name: of the column. order: all levels that it may have, in order, where that is known.
    """

    def __init__(self, name: str, order: tuple[Any, ...] | None = None) -> None:
        self.name, self._order = name, order
        self.counts: dict[Any, int] = {}
        self._first: dict[Any, int] = {}

    def add(self, values: pd.Series[Any], rows: Ints, source: str) -> None:
        """Look at some rows.

        Raises:
            UserError: more levels than a category may have.
        """
        found, levels = codes(values)
        if not len(levels):
            return
        counts = np.bincount(found[found >= 0], minlength=len(levels))
        _, at = np.unique(found[found >= 0], return_index=True)
        firsts = rows[found >= 0][at]
        for level, count, row in zip(levels.tolist(), counts.tolist(), firsts.tolist(), strict=True):
            self.counts[level] = self.counts.get(level, 0) + count
            self._first.setdefault(level, row)
        if len(self.counts) > LEVELS:
            self.alike(source)
            raise UserError(
                f"{source}: {self.name} has more than {LEVELS} different values (such as {self._some()}); leave it out "
                "of data.states and data.actions, put values together, or store it as a number"
            )

    def alike(self, source: str) -> None:
        """Refuse numbers among words, and words among numbers.

        Raises:
            UserError: with the value that stands against the others.
        """
        odd = odd_one(self.counts)
        if odd is not None:
            others = "words" if isinstance(odd, int | float) else "numbers"
            raise UserError(
                f"{source}: {self.name} of row {self._first[odd]} is {odd!r}, and most others are {others}; mend it, "
                "leave it empty, or leave the column out"
            )

    def ordered(self) -> tuple[Any, ...]:
        """Those that there are, in order."""
        if self._order is not None:
            return tuple(level for level in self._order if level in self.counts)
        try:
            return tuple(sorted(self.counts))
        except TypeError:
            return tuple(sorted(self.counts, key=str))

    def frequent(self) -> Any:
        """The most frequent; of equal ones the first in order."""
        return max(self.ordered(), key=lambda level: self.counts[level], default=None)

    def _some(self) -> str:
        return ", ".join(repr(level) for level in [*self.counts][:3])


def odd_one(counts: dict[Any, int]) -> Any:
    """A level that is of another type than most rows', by rows of each level; None where they are alike."""
    number = {level: _is_number(level) for level in counts}
    share = sum(count for level, count in counts.items() if number[level]) / max(sum(counts.values()), 1)
    kinds = {isinstance(level, str) for level in counts}
    if kinds == {True} and (share < 0.5 or share == 1):  # words, or numbers that are meant as names
        return None
    if kinds == {False} or not counts:
        return None
    return next((level for level in counts if number[level] != (share >= 0.5)), None)


def _is_number(level: Any) -> bool:
    try:
        float(level)
    except (TypeError, ValueError):
        return False
    return True


class Moments:
    """Mean, deviation and range of numbers, as chunks of rows come by; merged as Chan et al. do."""

    def __init__(self) -> None:
        self.count, self.mean, self.least, self.most, self._squares = 0, 0.0, np.inf, -np.inf, 0.0
        self.missing = 0

    def add(self, values: Floats) -> None:
        """Look at some; NaN count as missing."""
        for first in range(0, len(values), BLOCK):
            self._add(values[first : first + BLOCK])

    def _add(self, values: Floats) -> None:
        gaps = np.isnan(values)
        missing = int(np.count_nonzero(gaps))
        self.missing += missing
        if missing:
            values = values[~gaps]
        if not len(values):
            return
        mean, count = float(values.mean()), self.count + len(values)
        apart = mean - self.mean
        away = values - mean
        np.square(away, out=away)  # a product by BLAS would wake threads for each block
        self._squares += float(away.sum()) + apart**2 * self.count * len(values) / count
        self.mean += apart * len(values) / count
        self.count = count
        self.least, self.most = min(self.least, float(values.min())), max(self.most, float(values.max()))

    @property
    def deviation(self) -> float:
        """The root of the mean square distance from the mean."""
        return float(np.sqrt(self._squares / self.count)) if self.count else 0.0


def spread_out(first: int, count: int, total: int, wanted: int) -> NDArray[np.bool_]:
    """Which of rows first, first + 1, … are among about `wanted` of `total`, evenly spread [count].

    Every k-th row would always be the same day of the week for some k: multiples of the golden ratio have no period.
    """
    if total <= wanted:
        return np.ones(count, dtype=bool)
    at = np.arange(first, first + count, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return np.asarray(at < np.uint64(int(wanted / total * 2**64)))

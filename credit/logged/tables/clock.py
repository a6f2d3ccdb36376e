"""Times as numbers that can be compared, and what dates become as features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Ints

if TYPE_CHECKING:
    import pandas as pd

WEEKDAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
CALENDAR: dict[str, tuple[Any, ...] | None] = {  # name → all levels in order, None for a number
    "weekday": WEEKDAYS,
    "month": MONTHS,
    "quarter": ("Q1", "Q2", "Q3", "Q4"),
    "hour": tuple(range(24)),
    "weekend": None,
    "day": None,
    "dayofyear": None,
    "year": None,
}
FORMATS = ("%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y", "%Y/%m/%d", "%m/%d/%Y %H:%M", "%d/%m/%Y %H:%M", "%d.%m.%Y %H:%M")
ISO = r"\d{4}-\d{1,2}-\d{1,2}([ T]\d{1,2}:\d{2}.*)?"
PERIOD = r"(\d{4})\D{0,3}(\d{1,2})"  # 2024Q1, 2024-W05, 2024-03


@dataclass(frozen=True)
class Clock:
    """How a column says when a row was.

    Attributes:
        column: its name. kind: numbers, dates, text of dates in ISO or another format, or text such as 2024-W05.
        format: of the text.
    """

    column: str
    kind: str
    format: str = ""

    @property
    def dated(self) -> bool:
        """Whether calendar features can be made of it."""
        return self.kind in ("date", "iso", "text")

    def __call__(self, values: pd.Series[Any], rows: Ints, source: str) -> NDArray[Any]:
        """Comparable numbers [n]: microseconds of dates, else as they are.

        Raises:
            UserError: a value that is missing, or that is no time of this kind.
        """
        import pandas as pd

        if self.dated:
            return self.dates(values, rows, source).to_numpy().astype("datetime64[us]").astype(np.int64)
        if self.kind == "period":
            parts = values.astype("str").str.extract(f"^{PERIOD}$")
            times = (pd.to_numeric(parts[0]) * 100 + pd.to_numeric(parts[1])).astype(float)
        else:
            times = pd.to_numeric(values, errors="coerce").astype(float)
        self._complete(times, values, rows, source)
        return times.to_numpy()

    def dates(self, values: pd.Series[Any], rows: Ints, source: str) -> pd.Series[Any]:
        """The same as dates, without a time zone (their local time).

        Raises:
            UserError: as above.
        """
        import pandas as pd

        how = {"iso": "ISO8601", "text": self.format}.get(self.kind)
        if isinstance(values.dtype, pd.CategoricalDtype):
            values = values.astype(values.cat.categories.dtype)
        if isinstance(values.dtype, pd.PeriodDtype):
            values = values.dt.to_timestamp()
        dates = pd.to_datetime(values, errors="coerce", format=how)
        self._complete(dates, values, rows, source)
        return dates.dt.tz_localize(None) if dates.dt.tz is not None else dates

    def _complete(self, found: pd.Series[Any], values: pd.Series[Any], rows: Ints, source: str) -> None:
        bad = found.isna().to_numpy() | (found.to_numpy() == np.inf if self.kind == "number" else False)
        if not bad.any():
            return
        at = int(bad.argmax())
        value = values.iloc[at]
        what = "missing" if values.isna().iloc[at] else f"{str(value)!r}"
        said = {"number": "a number", "period": "like 2024-W05"}.get(self.kind, "a date such as 2024-01-31")
        raise UserError(
            f"{source}: {self.column} of row {rows[at]} is {what}, and it is the time of its row, here {said}; mend "
            "it, or name another column by data.time"
        )


def clock(name: str, values: pd.Series[Any]) -> Clock | None:
    """How a column says when, judged by some of its values; None: it does not."""
    import pandas as pd

    if isinstance(values.dtype, pd.CategoricalDtype):
        values = values.astype(values.cat.categories.dtype)
    if (
        values.dtype.kind == "M"
        or isinstance(values.dtype, pd.PeriodDtype)
        or str(values.dtype).startswith("datetime64")
    ):
        return Clock(name, "date")
    if values.dtype.kind in "iuf":
        return Clock(name, "number")
    if values.dtype.kind in "bm":
        return None
    some = values.dropna()
    if some.dtype == object and pd.api.types.infer_dtype(some, skipna=True) in ("date", "datetime", "datetime64"):
        return Clock(name, "date")
    if some.dtype == object and not all(isinstance(value, str) for value in some.iloc[:1000]):
        return None
    text = pd.Series(some.unique()[:2000]).astype("str")
    if not len(text):
        return None
    if _most(text.str.fullmatch(ISO)):
        return Clock(name, "iso")
    fits = [how for how in FORMATS if _most(pd.to_datetime(text, format=how, errors="coerce").notna())]
    if fits:
        rising = [how for how in fits if pd.to_datetime(text, format=how, errors="coerce").is_monotonic_increasing]
        return Clock(name, "text", (rising or fits)[0])
    return Clock(name, "period") if _most(text.str.fullmatch(PERIOD)) else None


def calendar(what: str, dates: pd.Series[Any]) -> NDArray[Any]:
    """A feature of dates: numbers of levels [n] where it has levels, and else numbers."""
    at = dates.dt
    found = {
        "weekday": lambda: at.weekday,
        "month": lambda: at.month - 1,
        "quarter": lambda: at.quarter - 1,
        "hour": lambda: at.hour,
        "weekend": lambda: (at.weekday >= 5).astype(float),
        "day": lambda: at.day.astype(float),
        "dayofyear": lambda: at.dayofyear.astype(float),
        "year": lambda: at.year.astype(float),
    }[what]()
    return np.asarray(found)


def _most(good: pd.Series[Any]) -> bool:
    """All but a few, which are mistakes to be named later."""
    return bool(good.fillna(False).mean() >= 0.95)

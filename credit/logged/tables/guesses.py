"""What columns seem to be, by their names and a sample of rows. A guess is said, and gives way to what a user says."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Ints
from credit.logged.tables.clock import CALENDAR, Clock, clock
from credit.logged.tables.columns import Kind, codes, kind

if TYPE_CHECKING:
    import pandas as pd

WINDOW = ("window", "episode", "trajectory", "traj", "rollout", "order", "trip", "visit", "batch", "block", "interval",
          "period", "week", "month", "quarter", "year", "shift", "day", "date")  # fmt: skip
LABEL = ("label", "y", "target", "outcome", "sales", "revenue", "kpi", "conversions", "success", "total", "response",
         "demand", "result", "return")  # fmt: skip
GRID = 0.9  # of all pairs of time and group that there could be
TIME = ("time", "timestamp", "datetime", "date", "ds", "day", "hour", "minute", "second", "step", "t", "tick", "week",
        "month", "quarter", "year")  # fmt: skip
GROUP = ("group", "seed", "region", "store", "shop", "market", "geo", "country", "state", "city", "site", "customer",
         "patient", "user", "subject", "unit", "series", "panel", "sku", "product", "brand", "origin",
         "machine", "device")  # fmt: skip


SURE = ("window", "episode", "trajectory", "traj", "rollout")  # of a window's names those that mean nothing else


def named(column: str, words: Sequence[str]) -> int | None:
    """The place among words of one that the name of a column has in it; None: none."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column)
    parts = [part for part in re.split(r"[^A-Za-z]+", spaced.lower()) if part]
    found = [words.index(part) for part in parts if part in words]
    return min(found, default=None)


class Sample:
    """Some rows, and what has been found out about their columns."""

    def __init__(self, frame: pd.DataFrame, source: str) -> None:
        self.frame, self.source = frame, source
        self.kinds: dict[str, Kind] = {str(name): kind(frame[name]) for name in frame.columns}
        self._codes: dict[str, Ints] = {}

    def __len__(self) -> int:
        return len(self.frame)

    def codes(self, *names: str | None) -> Ints:
        """Numbers of the combinations of values of some columns [n]."""
        found = np.zeros(len(self), dtype=np.int64)
        for name in names:
            if name is None:
                continue
            if self.kinds[name] == "other":
                raise UserError(
                    f"{self.source}: {name} holds neither numbers nor words, and so it cannot tell rows apart"
                )
            if name not in self._codes:
                self._codes[name] = codes(self.frame[name])[0] + 1
            mixed = found * (int(self._codes[name].max()) + 1) + self._codes[name]
            found = np.unique(mixed, return_inverse=True)[1]
        return found

    def levels(self, name: str) -> int:
        """How many different values there are."""
        return int(np.unique(self.codes(name)).size)

    def single(self, name: str, at: Ints) -> bool:
        """Whether all values of a column with the same number have the same value, or none."""
        values = np.asarray(self.frame[name], dtype=np.float64)
        order = np.argsort(at, kind="stable")
        starts = np.flatnonzero(np.diff(at[order], prepend=-1))
        low, high = np.fmin.reduceat(values[order], starts), np.fmax.reduceat(values[order], starts)
        seen = ~np.isnan(low)
        return bool((low == high)[seen].all() and seen.mean() > 0.25 and len(np.unique(low[seen])) > 1)

    def clock(self, name: str) -> Clock | None:
        """How a column tells the time."""
        return clock(name, self.frame[name])

    def dated(self, name: str) -> bool:
        """Whether it holds dates, as such or as text."""
        if self.kinds[name] == "date":
            return True
        found = None if self.kinds[name] != "category" else self.clock(name)
        return found is not None and found.kind in ("iso", "text")


def series(
    sample: Sample, names: Sequence[str], time: Any, group: Any, features: Sequence[str] = ()
) -> tuple[str | None, str | None]:
    """The columns of time and group: those by which no two rows are at the same time in the same group.

    Args:
        names: columns to choose from. time, group: given ones; False for none, None to guess. features: of names those
            that a user said to be states, which tell series apart only where each has a row at (nearly) each time.
    """
    dated = [name for name in names if sample.dated(name)]
    numeric = [name for name in names if sample.kinds[name] == "number" and named(name, TIME) is not None]
    numeric.sort(key=lambda name: named(name, TIME) or 0)
    times: list[str] = [time] if time else [] if time is False else [*dated, *numeric]
    groups = [group] if group else [None] if group is False else [None, *_groups(sample, names, times)]
    for when in times:
        at = sample.codes(when)
        for who in groups:
            if who == when or np.unique(sample.codes(who) * (int(at.max()) + 1) + at).size < len(sample):
                continue
            if who is None or who not in features or len(sample) >= GRID * sample.levels(who) * sample.levels(when):
                return when, who
    who = group or None
    if group is None:
        likely = [name for name in groups if name and name not in features and named(name, GROUP) is not None]
        who = likely[0] if likely else None
    if time:
        return time, who
    return next((name for name in dated if name in times and rises(sample, name, who)), None), who


def rises(sample: Sample, time: str, group: str | None) -> bool:
    """Whether a time never falls within a group, as rows lie."""
    found = sample.clock(time)
    if found is None or sample.frame[time].isna().any():
        return False
    at = found(sample.frame[time], np.arange(len(sample)), sample.source)
    order = np.argsort(sample.codes(group), kind="stable")
    same = np.diff(sample.codes(group)[order]) == 0
    return bool((np.diff(at[order])[same] >= 0).all())


def _groups(sample: Sample, names: Sequence[str], times: Sequence[str]) -> list[str]:
    found = []
    for name in names:
        word = named(name, GROUP)
        text = sample.kinds[name] == "category" and not sample.dated(name)
        coded = sample.kinds[name] == "number" and whole(sample.frame[name]) and word is not None
        if (text or coded) and name not in times and 2 <= (levels := sample.levels(name)) <= len(sample) / 2:
            found.append((word is None, word or 0, levels, name))
    return [name for *_, name in sorted(found)]


def whole(values: pd.Series[Any]) -> bool:
    """Whether all numbers are whole ones."""
    some = np.asarray(values, dtype=np.float64)
    return bool((some == np.floor(some)).all())


def windows(
    sample: Sample, names: Sequence[str], window: str | None, label: str | None, time: str | None, group: str | None
) -> tuple[str, str]:
    """The columns of window and label: the longest windows in which some column has one value, or what names tell.

    Raises:
        UserError: nothing fits, or several.
    """
    found = founded(sample, names, window, label, time, group)
    return found or _unfounded(sample, names, window, label, group)


def founded(
    sample: Sample, names: Sequence[str], window: str | None, label: str | None, time: str | None, group: str | None
) -> tuple[str, str] | None:
    """The same by values alone; None: nothing fits.

    Raises:
        UserError: several fit.
    """
    numeric = [name for name in names if sample.kinds[name] == "number"]
    other = [name for name in numeric if name not in (time, group, window)]
    labels = [label] if label else [name for name in other if named(name, (*WINDOW, *TIME, *CALENDAR)) is None]
    found = []
    for name in [window] if window else names:
        if name == label or (not window and (name == time or not _names_windows(sample, name))):
            continue
        at = sample.codes(group, name)
        count = int(at.max()) + 1
        word = named(name, WINDOW)
        sure = word is not None and WINDOW[word] in SURE
        if not window and (count < 2 or count > len(sample) / (1 if sure else 1.5)):
            continue
        for what in labels:
            if what != name and sample.kinds[what] == "number" and sample.single(what, at):
                known = named(what, LABEL)
                unnamed = 0 if window or name.lower() == SURE[0] else 1 if word is not None else 2
                rank = (known is None and not label, known or 0, unnamed, count, word or 0)
                found.append((rank, name, what))
    if not found:
        return None
    best = min(found)
    rivals = sorted({what for rank, name, what in found if name == best[1] and rank[0]})
    if best[0][0] and len(rivals) > 1:
        raise UserError(
            f"{sample.source}: which column is the label cannot be told: {', '.join(rivals)} each have one value in a "
            f"{best[1]}; say data.label=…"
        )
    return best[1], best[2]


def _names_windows(sample: Sample, name: str) -> bool:
    if sample.kinds[name] == "number":
        some = sample.frame[name].dropna()
        return named(name, WINDOW) is not None or (whole(some) and sample.levels(name) > 2)
    return sample.kinds[name] in ("category", "date")


def _unfounded(
    sample: Sample, names: Iterable[str], window: str | None, label: str | None, group: str | None
) -> tuple[str, str]:
    """What a name alone tells, to be checked on all rows later."""
    likely = [
        name for name in names if named(name, WINDOW) is not None and _names_windows(sample, name) and name != label
    ]
    likely = [name for name in likely if 1 < int(sample.codes(group, name).max()) + 1 < len(sample)]
    called = [name for name in names if named(name, LABEL) is not None and sample.kinds[name] == "number"]
    window = window or min(likely, key=lambda name: named(name, WINDOW) or 0, default=None)
    label = label or min(called, key=lambda name: named(name, LABEL) or 0, default=None)
    listing = f"(columns: {', '.join(names)})"
    if window is None:
        raise UserError(f"{sample.source}: which rows share a label cannot be told; say data.window=… {listing}")
    if label is None:
        raise UserError(
            f"{sample.source}: no column has one value in each {window}, and so which is the label cannot be told; say "
            f"data.label=…, or data.labels=FILE where labels are in a second table {listing}"
        )
    return window, label

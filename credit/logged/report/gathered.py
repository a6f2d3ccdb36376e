"""What a page needs of rows, added up: by time, by group and by what was done, however many rows there are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged import binning
from credit.logged.binning import Bin, Bins
from credit.logged.models import parts_of
from credit.logged.panel import Floats, Ints
from credit.logged.periods import periods

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.result import LoggedCredit

TOP = 10  # rows that are shown


@dataclass(frozen=True)
class Share:
    """Some of the rows.

    Attributes:
        name: what they share. rows: how many. credit, disagreement: their means. apart: how far the models that lie
            farthest from each other are from each other, on average.
    """

    name: str
    rows: int
    credit: float
    disagreement: float
    apart: float


@dataclass(frozen=True)
class Gathered:
    """Rows, added up over P periods.

    Attributes:
        when: what the time was when each period began, as words [P]. rows: in each [P].
        label, held_out: means over the windows that have a label and a prediction, of each model and the mixture
            [P], [M + 1, P]. credit, low, high, disagreement: means over rows [P]. each: of each model [M, P].
        groups, actions: rows of each group, and of each level of an action. top: rows where models lie farthest apart.
    """

    when: tuple[str, ...]
    rows: Floats
    label: Floats
    held_out: Floats
    credit: Floats
    low: Floats
    high: Floats
    disagreement: Floats
    each: Floats
    groups: tuple[Share, ...]
    actions: tuple[Share, ...]
    top: pd.DataFrame


def gathered(result: LoggedCredit) -> Gathered:
    """Add up what was found, in one pass over the table."""
    panel, rows, judged = result.found.panel, result.rows, result.judged
    windows = panel.windows
    apart = rows.each.max(0) - rows.each.min(0)
    period = periods(windows)
    count = int(period.max(initial=-1)) + 1
    starts = np.concatenate([[0], np.cumsum(windows.steps)[:-1]]).astype(np.int64)
    length = np.bincount(period, weights=windows.steps, minlength=count).astype(np.float64)

    def mean(values: Floats) -> Floats:
        return np.bincount(period, weights=np.add.reduceat(values, starts), minlength=count) / length

    seen = windows.labelled & np.isfinite(judged.held_out[-1])
    share = np.bincount(period[seen], minlength=count).astype(np.float64)
    share[share == 0] = np.nan

    def of_windows(values: Floats) -> Floats:
        return np.bincount(period[seen], weights=values[seen], minlength=count) / share

    by_group = _shares(
        [str(name) for name in windows.groups],
        windows.group,
        windows.steps,
        *(np.add.reduceat(values, starts) for values in (rows.credit, rows.disagreement, apart)),
    )
    top = _farthest(apart)
    when, actions, times = _of_parts(result, period, count, apart, top)
    return Gathered(
        when=when,
        rows=length,
        label=of_windows(windows.label),
        held_out=np.array([of_windows(one) for one in judged.held_out[-len(result.models) :]]),
        credit=mean(rows.credit),
        low=mean(rows.low),
        high=mean(rows.high),
        disagreement=mean(rows.disagreement),
        each=np.array([mean(one) for one in rows.each]),
        groups=by_group if panel.roles.group else (),
        actions=actions,
        top=_top(result, starts, apart, top, times),
    )


def _shares(names: Sequence[str], place: Ints, rows: Ints, *sums: Floats) -> tuple[Share, ...]:
    """Sums of parts [n], each at its place, as means of each name; those of no rows are left out."""
    every = zip(names, *(np.bincount(place, weights=one, minlength=len(names)) for one in (rows, *sums)), strict=True)
    return tuple(_share(name, of) for name, *of in every if of[0])


def _share(name: str, sums: Sequence[float]) -> Share:
    """Of rows, and sums of credit, disagreement and how far models lie apart."""
    rows, *others = sums
    return Share(name, int(rows), *(float(one / rows) for one in others))


def _of_parts(
    result: LoggedCredit, period: Ints, count: int, apart: Floats, top: Ints
) -> tuple[tuple[str, ...], tuple[Share, ...], list[str]]:
    """When each period began, rows by what was done, and when the top rows were (no words where there is no time)."""
    panel, rows = result.found.panel, result.rows
    roles, time = panel.roles, panel.windows.time
    order = np.lexsort((time, period))
    first = order[np.unique(period[order], return_index=True)[1]]  # a window of each period that begins when it does
    when, sums, times = [""] * count, Bins(), [""] * len(top)
    for part, at in parts_of(panel):
        if roles.time is not None and roles.time in part.frame.columns:
            begins = part.frame[roles.time].iloc[part.starts]
            for one in np.flatnonzero((first >= part.window[0]) & (first <= part.window[-1])):
                when[one] = _said(begins.iloc[int(first[one] - part.window[0])])
            for one in np.flatnonzero((top >= at.start) & (top < at.stop)):
                times[one] = _said(part.frame[roles.time].iloc[int(top[one]) - at.start])
        for name in roles.actions:
            for number, held, few in binning.binned(part.frame[name], panel.columns[name]):
                more = [values[at][held].sum() for values in (rows.credit, rows.disagreement, apart)]
                some = Bin(np.append(few.sums, more), few.low, few.high)
                sums[name, number] = sums[name, number].add(some) if (name, number) in sums else some
    if not any(when):
        when = [str(1 + int(time[window])) for window in first]
    actions = [
        _share(
            f"{name}{' =' if panel.columns[name].levels else ''} {binning.name(panel.columns[name], number, one)}",
            one.sums.tolist(),
        )
        for (name, number), one in sorted(sums.items(), key=lambda item: (roles.actions.index(item[0][0]), item[0][1]))
    ]
    return tuple(when), tuple(actions), times


def _said(value: Any) -> str:
    """A time as words; a date without its midnight."""
    return str(value).removesuffix(" 00:00:00")


def _farthest(apart: Floats) -> Ints:
    """The rows in which models lie farthest apart, the farthest first."""
    many = min(TOP, len(apart))
    top = np.argpartition(-apart, many - 1)[:many]
    return top[np.lexsort((top, -apart[top]))].astype(np.int64)


def _top(result: LoggedCredit, starts: Ints, apart: Floats, top: Ints, times: Sequence[str]) -> pd.DataFrame:
    """The rows where models lie farthest apart: which they are, what each model says, and what may be off."""
    import pandas as pd

    panel, rows = result.found.panel, result.rows
    roles = panel.roles
    window = np.searchsorted(starts, top, side="right") - 1
    groups = [panel.windows.groups[one] for one in panel.windows.group[window]]
    return pd.DataFrame(
        {
            **({roles.group: groups} if roles.group else {}),
            roles.window: panel.windows.id[window],
            **({roles.time: times} if roles.time and any(times) else {}),
            "row": rows.number[top],
            **{f"by model “{name}”": rows.each[m, top] for m, name in enumerate(result.found.names)},
            "mixture": rows.credit[top],
            "apart": apart[top],
            "disagreement": rows.disagreement[top],
        }
    )

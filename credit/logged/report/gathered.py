"""What a page needs of rows, added up: by time, by group and by what was done, however many rows there are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.claims import bins
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
        name: what they share. rows: how many. credit, disagreement: their means.
    """

    name: str
    rows: int
    credit: float
    disagreement: float


@dataclass(frozen=True)
class Gathered:
    """Rows, added up over P periods.

    Attributes:
        when: what the time was when each period began, as words [P]. rows: in each [P].
        label, held_out: means over the windows that have a label and a prediction, of each model and the mixture
            [P], [M + 1, P]. credit, low, high, disagreement: means over rows [P]. each: of each model [M, P].
        groups, actions: rows of each group, and of each level of an action. top: rows where models disagree most.
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
        np.add.reduceat(rows.credit, starts),
        np.add.reduceat(rows.disagreement, starts),
    )
    when, actions = _of_parts(result, period, count)
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
        top=_top(result, starts),
    )


def _shares(names: Sequence[str], place: Ints, rows: Ints, credit: Floats, disagreement: Floats) -> tuple[Share, ...]:
    """Sums of parts [n], each at its place, as means of each name; those of no rows are left out."""
    count, sums, unsure = (
        np.bincount(place, weights=one, minlength=len(names)) for one in (rows, credit, disagreement)
    )
    return tuple(
        Share(name, int(many), one / many, other / many)
        for name, many, one, other in zip(names, count, sums, unsure, strict=True)
        if many
    )


def _of_parts(result: LoggedCredit, period: Ints, count: int) -> tuple[tuple[str, ...], tuple[Share, ...]]:
    """When each period began, and rows by what was done."""
    panel, rows = result.found.panel, result.rows
    roles, time = panel.roles, panel.windows.time
    order = np.lexsort((time, period))
    first = order[np.unique(period[order], return_index=True)[1]]  # a window of each period that begins when it does
    when, sums = [""] * count, dict[tuple[str, str], Floats]()
    for part, at in parts_of(panel):
        if roles.time is not None and roles.time in part.frame.columns:
            begins = part.frame[roles.time].iloc[part.starts]
            for one in np.flatnonzero((first >= part.window[0]) & (first <= part.window[-1])):
                when[one] = _said(begins.iloc[int(first[one] - part.window[0])])
        for name in roles.actions:
            for value, held in bins(part.frame[name], panel.columns[name]):
                own = (float(held.sum()), rows.credit[at][held].sum(), rows.disagreement[at][held].sum())
                sums[name, value] = sums.get((name, value), np.zeros(3)) + own
    if not any(when):
        when = [str(1 + int(time[window])) for window in first]
    actions = [
        Share(
            f"{name} = {value}" if panel.columns[name].levels else f"{name} {value}", int(many), one / many, two / many
        )
        for (name, value), (many, one, two) in sums.items()
        if many
    ]
    return tuple(when), tuple(actions)


def _said(value: Any) -> str:
    """A time as words; a date without its midnight."""
    return str(value).removesuffix(" 00:00:00")


def _top(result: LoggedCredit, starts: Ints) -> pd.DataFrame:
    """The rows where models disagree most: which they are, and what each model says."""
    import pandas as pd

    panel, rows = result.found.panel, result.rows
    many = min(TOP, panel.rows)
    top = np.argpartition(-rows.disagreement, many - 1)[:many]
    top = top[np.lexsort((top, -rows.disagreement[top]))]
    window = np.searchsorted(starts, top, side="right") - 1
    groups = [panel.windows.groups[one] for one in panel.windows.group[window]]
    return pd.DataFrame(
        {
            **({panel.roles.group: groups} if panel.roles.group else {}),
            panel.roles.window: panel.windows.id[window],
            "row": rows.number[top],
            **{f"by model “{name}”": rows.each[m, top] for m, name in enumerate(result.found.names)},
            "mixture": rows.credit[top],
            "disagreement": rows.disagreement[top],
        }
    )

"""Logged data opened: what was given is found, its columns get roles, rows are ordered, checked and surveyed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Ints, Panel, Roles, Windows
from credit.logged.tables import minari
from credit.logged.tables.clashes import require_apart
from credit.logged.tables.clock import CALENDAR
from credit.logged.tables.columns import numbers
from credit.logged.tables.copies import require_single
from credit.logged.tables.exported import exported
from credit.logged.tables.features import Features, Gaps, Survey
from credit.logged.tables.guesses import Sample
from credit.logged.tables.keys import Runs, Split
from credit.logged.tables.known import Known
from credit.logged.tables.roles import Settled, check_baseline, settled
from credit.logged.tables.second import joined
from credit.logged.tables.sorting import copies, in_order, twins
from credit.logged.tables.sources import MEMORY, Source, located
from credit.logged.tables.table import Table
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    import pandas as pd


def opened(data: Any, given: Mapping[str, Any] | None = None, *, memory: int = MEMORY) -> Panel:
    """Open a table of steps with labels on windows.

    Args:
        data: a path, a pattern, a folder, a list of paths, a pandas frame, or a Minari dataset. given: the words
            `data.*` (`Words`).
        memory: bytes of a table that may be held whole; larger files are read in parts.

    Raises:
        UserError: whatever is wrong with it, with column, row, value and remedy. Rows are counted from 0.
    """
    words = Words.of(given)
    if (name := minari.dataset(data)) is not None:
        data, own = minari.opened(name, words)
        words = Words.of(own | {word: value for word, value in (given or {}).items() if value is not None})
    elif words.steps is not None:
        raise UserError("data.steps has no effect: it is of a Minari dataset; a table says its windows in a column")
    source = located(data, memory)
    second = second_of(words.labels, memory)
    sample = Sample(source.sample(), source.name)
    own, more = exported(data, source, sample, given or {})
    words = Words.of(own) if more else words
    more += require_single(words, sample, source, second)
    what = settled(words, sample, second)
    roles, said = what.roles, [*source.said, *more, *what.said]
    require_apart(roles, (), source.name)
    features = Features(what.kinds, what.dates, what.calendar, words.missing, source.name)
    extra = [*roles.cost.values(), *([roles.propensity] if roles.propensity else []), *roles.next_states]
    try:
        source, windows, first, more = cut(source, what, [*features.needed], extra, second is None, memory)
    except Split as error:
        if not (same := copies(source)):
            raise
        raise UserError(f"{source.name}: {same}. As they are, {str(error).removeprefix(f'{source.name}: ')}") from None
    said += more
    if second is not None:
        windows, more = labelled(windows, second, roles, words.labels)
        said += more
    _check_labels(windows, first, roles, source.name)
    if words.label_is == roles.label_is != "binary" and not (given or {}).get("label_is"):  # as data say of themselves
        said += _bits(windows, roles.label)

    survey = Survey(features, roles.stock, source.rows, {name: CALENDAR[of] for name, of in what.dates.items()})
    steps = surveyed(source, survey, [*dict.fromkeys([*features.needed, *extra])], roles, windows.steps)
    features.columns = survey.columns()
    baseline = {
        name: check_baseline(value, name, features.columns[name].levels, source.name)
        for name, value in roles.baseline.items()
    }
    lengths, windows, more = left(windows, steps, survey, words.missing)
    if more and words.missing == "drop":
        _check_labels(windows, first[steps > 0], roles, source.name)
    roles = replace(roles, baseline=baseline)
    known = Known(roles, what.clock, what.kinds, what.dates, what.calendar, words.missing, features.columns)
    return Table(source, known, features, windows, lengths, [*said, *more])


def cut(
    source: Source, what: Settled, features: Sequence[str], extra: Sequence[str], in_rows: bool, memory: int
) -> tuple[Source, Windows, Ints, list[str]]:
    """Rows in order, cut into windows.

    Args:
        source: rows as they lie. what: their columns. features: columns that these are made of. extra: further ones
            that are needed. in_rows: whether labels stand in rows. memory: bytes that may be held.

    Returns:
        The rows in order, their windows, the first row of each, and what there is to say.

    Raises:
        UserError: rows without a window, group or time, labels that differ in a window, rows that are there twice.
    """
    roles, said = what.roles, []
    runs = _walked(source, Runs(roles, what.clock, source.name, in_rows))
    own = [*dict.fromkeys([*runs.columns, *features])]
    if not runs.ordered or runs.scattered():
        source = in_order(source, [*dict.fromkeys([*own, *extra])], roles, what.clock, memory)
        within = [roles.window, what.clock.column] if what.clock and not roles.time else [roles.time]
        order = ", ".join(name for name in (roles.group, *within) if name)
        said.append(f"rows were sorted by {order}, equal ones as they lay")
        runs = _walked(source, Runs(roles, what.clock, source.name, in_rows))
    windows, first = runs.finished()
    return source, windows, first, [*said, *_twins(source, own, runs.tied())]


def labelled(windows: Windows, second: pd.DataFrame, roles: Roles, given: Any) -> tuple[Windows, list[str]]:
    """Windows with their labels from a second table, and what there is to say; `given` is what it was given as."""
    label, said = joined(windows, second, roles, f"data.labels ({given})" if isinstance(given, str) else "data.labels")
    return replace(windows, label=label), said


def second_of(labels: Any, memory: int) -> pd.DataFrame | None:
    """The second table, which has one row a window."""
    if labels is None:
        return None
    source = located(labels, memory)
    return source.whole(source.columns)[0]


def _walked(source: Source, runs: Runs) -> Runs:
    """Windows as rows come by, as far as they are in order."""
    for frame, rows in source.chunks(runs.columns):
        runs.add(frame, rows)
        if not runs.ordered:
            break
    return runs


def _twins(source: Source, columns: Sequence[str], tied: Ints) -> list[str]:
    """Refuse rows that are there twice; where times are shared by other rows, too, equal ones may be meant.

    Raises:
        UserError: with the first.
    """
    if not len(tied):
        return []
    same = twins(source, columns, tied)
    if same.all():
        pair = _numbers_of(source, columns[:1], int(tied[0]))
        more = f", and so are {len(tied)} pairs" if len(tied) > 1 else ""
        raise UserError(
            f"{source.name}: rows {pair[0]} and {pair[1]} are the same{more}; keep one of each (in pandas: "
            "drop_duplicates), or leave data.time out if both happened (data.time=false)"
        )
    some = f", {int(same.sum())} of them in all columns" if same.any() else ""
    return [f"{len(tied)} rows have the time of the row before{some}; they stay as they lay"]


def _numbers_of(source: Source, columns: Sequence[str], at: int) -> list[int]:
    first, found = 0, []
    for _, rows in source.chunks(columns):
        found += [int(rows[i - first]) for i in (at - 1, at) if first <= i < first + len(rows)]
        first += len(rows)
        if first > at:
            break
    return sorted(found)


def _check_labels(windows: Windows, first: Ints, roles: Roles, source: str) -> None:
    """Refuse labels that nothing can be learned from.

    Raises:
        UserError: one window, no label, all alike, or no bits where bits were promised.
    """
    if len(windows) == 1:
        raise UserError(
            f"{source}: there is one window only ({roles.window} {windows.id[0]}), from which no share of a row can be "
            "told; give several, or name another column by data.window"
        )
    known = windows.label[windows.labelled]
    if not len(known):
        raise UserError(f"{source}: {roles.label} is empty in all {len(windows)} windows; give labels to some")
    if len(known) == 1:
        raise UserError(
            f"{source}: one of {len(windows)} windows has a label ({roles.label}); at least two must have one"
        )
    if (known == known[0]).all():
        raise UserError(
            f"{source}: {roles.label} is {known[0]:g} in all windows that have a label: where labels are alike nothing "
            "can be told of rows; name another column by data.label if there is one"
        )
    check_bits(windows, first, roles, source)


def _bits(windows: Windows, label: str) -> list[str]:
    """A sentence where all labels are 0 or 1, and are taken as numbers."""
    if not np.isin(windows.label[windows.labelled], (0, 1)).all():
        return []
    return [
        f"{label} is 0 or 1 in all windows, and taken as a number; data.label_is=binary is for bits, such as success"
    ]


def check_bits(windows: Windows, first: Ints, roles: Roles, source: str) -> None:
    """Refuse labels that are no bits where bits were promised.

    Raises:
        UserError: with the first.
    """
    if roles.label_is == "binary" and (bad := windows.labelled & ~np.isin(windows.label, (0, 1))).any():
        at = int(bad.argmax())
        raise UserError(
            f"{source}: {roles.label} of {roles.window} {windows.id[at]} (from row {first[at]}) is "
            f"{windows.label[at]:g}, and data.label_is=binary allows 0 and 1"
        )


def surveyed(source: Source, survey: Gaps, columns: Sequence[str], roles: Roles, lengths: Ints) -> Ints:
    """Look at all rows; how many of each window stay [W]."""
    ends = np.cumsum(lengths)
    steps, seen = lengths.copy(), 0
    for frame, rows in source.chunks(columns):
        keep = survey.add(frame, rows, source.name)
        if not keep.all():
            gone = np.flatnonzero(~keep) + seen
            steps -= np.bincount(np.searchsorted(ends, gone, side="right"), minlength=len(steps))
        seen += len(rows)
        for name in roles.cost.values():
            numbers(frame[name], rows, source.name, "a cost")
        for name in roles.next_states:
            numbers(frame[name], rows, source.name, "a state behind a step")
        if roles.propensity is not None:
            values = numbers(frame[roles.propensity], rows, source.name, "a probability")
            if (bad := ~((values > 0) & (values <= 1))).any():
                at = int(bad.argmax())
                raise UserError(
                    f"{source.name}: {roles.propensity} of row {rows[at]} is {values[at]:g}; data.propensity is a "
                    "probability of what was done, above 0 and at most 1"
                )
    survey.complete(source.name)
    return steps


def left(windows: Windows, steps: Ints, survey: Gaps, missing: str) -> tuple[Ints, Windows, list[str]]:
    """Lengths of all windows in the source, the windows that are left, and what there is to say of missing values."""
    lacking = {name: count for name, count in survey.gaps.items() if count}
    if not lacking:
        return windows.steps, windows, []
    counts = ", ".join(f"{name} {count}" for name, count in lacking.items())
    if missing == "mean":
        return (
            windows.steps,
            windows,
            [f"missing values are the column's mean, or its most frequent word (rows: {counts})"],
        )
    left = steps > 0
    gone = int((windows.steps - steps).sum())
    said = [f"{gone} rows with missing values ({counts}) are left out, and so they are not in their windows' sums"]
    if not left.all():
        said.append(f"{int((~left).sum())} windows have no rows left, and are left out")
    kept = {name: getattr(windows, name)[left] for name in ("id", "group", "time", "label", "key")}
    return windows.steps, replace(windows, steps=steps[left], **kept), said

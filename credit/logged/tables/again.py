"""Another table opened as an earlier one was: the same columns with the same meaning, labels where there are some."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError, nearest
from credit.logged.panel import Ints, Roles
from credit.logged.tables.clashes import require_apart
from credit.logged.tables.clock import Clock
from credit.logged.tables.copies import said_copies
from credit.logged.tables.cutting import restarts
from credit.logged.tables.features import Features, Gaps, level_codes
from credit.logged.tables.guesses import Sample
from credit.logged.tables.known import Known
from credit.logged.tables.opening import check_bits, cut, labelled, left, second_of, surveyed
from credit.logged.tables.roles import Settled
from credit.logged.tables.sources import MEMORY, located
from credit.logged.tables.table import Table
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    import pandas as pd

NEW = ("window", "label", "labels", "time", "group", "missing")  # words that may differ from table to table
SAID = {"window": "says which rows share a label", "time": "orders rows", "group": "tells series apart"}


def opened_again(
    data: Any, given: Mapping[str, Any] | None, known: Known, *, models: Iterable[str] = (), memory: int = MEMORY
) -> Table:
    """Open a table whose rows are to be scored.

    Without the column of windows every row is a window of its own, and without that of labels none has one.

    Args:
        data: as `opened` takes it. given: words `data.*`, of `NEW` alone. known: how the earlier one was read.
        models: names of what scores. memory: bytes of a table that may be held whole.

    Raises:
        UserError: a column that is missing or of another kind, a category's value that the earlier table had not, a
            word that has no effect, and whatever is wrong with a table of its own.
    """
    words = Words.of(given)
    if others := [word for word in given or {} if word not in NEW]:
        raise UserError(
            f"data.{others[0]} has no effect: the saved model says it; words that may be given are "
            f"{', '.join(f'data.{word}' for word in NEW)}"
        )
    source = located(data, memory)
    second = second_of(words.labels, memory)
    sample = Sample(source.sample(), source.name)
    missing = words.missing if "missing" in (given or {}) else known.missing
    what = _settled(words, sample, second, known)
    roles, said = what.roles, [*source.said, *said_copies(sample, source), *what.said]
    require_apart(roles, models, source.name)

    features = Features(what.kinds, what.dates, what.calendar, missing, source.name)
    features.columns = known.columns
    source, windows, first, more = cut(source, what, features.needed, [], second is None and roles.label != "", memory)
    said += more
    if second is not None:
        windows, more = labelled(windows, second, roles, words.labels)
        said += more
    check_bits(windows, first, roles, source.name)
    match = Match(features)
    steps = surveyed(source, match, features.needed, roles, windows.steps)
    lengths, windows, more = left(windows, steps, match, missing)
    if not len(windows):
        raise UserError(f"{source.name}: each row lacks a value ({', '.join(features.needed)}), and none is left")
    again = replace(known, roles=roles, clock=what.clock, calendar=what.calendar, missing=missing)
    return Table(source, again, features, windows, lengths, [*said, *more, *match.beyond()])


def _settled(words: Words, sample: Sample, labels: pd.DataFrame | None, known: Known) -> Settled:
    """Which column is what, as it was, but for what is said."""
    roles, source, said = known.roles, sample.source, []
    if gone := [name for name in known.needed if name not in sample.kinds]:
        lines = [f"there is no column {name!r}, which the model needs; {nearest(name, sample.kinds)}" for name in gone]
        raise UserError("\n".join(f"{source}: {line}" for line in lines))
    for name, kind in known.kinds.items():
        if name not in known.dates:
            _alike(name, kind, sample)
    time, group = _named("time", words.time, roles.time, sample), _named("group", words.group, roles.group, sample)
    clock = _clock(time, known.clock, sample) if time else None
    if time is None and words.time is None and known.clock and known.clock.column in sample.kinds:
        clock = _clock(known.clock.column, known.clock, sample)  # it orders rows within windows
    calendar = _clock(known.calendar.column, known.calendar, sample) if known.calendar else None

    window = _window(words, roles, sample)
    if clock and words.time and window and restarts(sample, clock, group, window):
        time = None
    clock = clock if time or window else None
    label = _label(words, roles, sample, labels, window)
    if not window:
        said.append(f"there is no column {roles.window!r} (data.window), and so rows alone are scored, no windows")
    elif not label:
        said.append(f"there is no column {roles.label!r} (data.label), and so labels are predicted alone")
    roles = replace(
        roles, window=window, label=label, time=time, group=group, baseline={}, cost={}, randomised=(), propensity=None,
        next_states=roles.next_states if all(name in sample.kinds for name in roles.next_states) else (),
    )  # fmt: skip
    return Settled(roles, clock, known.kinds, known.dates, calendar, tuple(said))


def _window(words: Words, roles: Roles, sample: Sample) -> str:
    """The column of windows; "" for none.

    Raises:
        UserError: it is not there, and was said or is needed.
    """
    window = words.window or (roles.window if roles.window in sample.kinds else "")
    if window and window not in sample.kinds:
        why = f"data.window={window}: there is no such column"
    elif not window and roles.stock and roles.label_is in ("sum", "binary"):
        levels = ", ".join(roles.stock)
        why = f"there is no column {roles.window!r} (data.window), and of a level ({levels}) a window has the mean"
    elif not window and (words.label or words.labels is not None):
        why = f"there is no column {roles.window!r} (data.window), and labels are of windows"
    else:
        return window
    raise UserError(f"{sample.source}: {why}; {nearest(window or roles.window, sample.kinds)}")


def _label(words: Words, roles: Roles, sample: Sample, labels: pd.DataFrame | None, window: str) -> str:
    """The column of labels, in a second table where there is one; "" for none.

    Raises:
        UserError: it is not there, and was said or is needed.
    """
    label = words.label or roles.label
    there = list(sample.kinds) if labels is None else [str(name) for name in labels.columns]
    if labels is not None and window not in there:
        raise UserError(f"data.labels: there is no column {window!r} (data.window); {nearest(window, there)}")
    if label not in there and (words.label or labels is not None):
        source = sample.source if labels is None else "data.labels"
        raise UserError(f"{source}: there is no column {label!r} (data.label); {nearest(label, there)}")
    return label if window and label in there else ""


def _named(word: str, given: str | bool | None, was: str | None, sample: Sample) -> str | None:
    """The column that a word names: as said, or as it was.

    Raises:
        UserError: it is not there.
    """
    name = was if given is None else given
    if not name:
        return None
    if name not in sample.kinds:
        what = f"; data.{word}=COLUMN names another one, data.{word}=false none" if given is None else ""
        raise UserError(
            f"{sample.source}: there is no column {name!r}, which {SAID[word]} (data.{word}); "
            f"{nearest(str(name), sample.kinds)}{what}"
        )
    return str(name)


def _clock(name: str, was: Clock | None, sample: Sample) -> Clock:
    """How a column says when; day and month of text in the order that they had.

    Raises:
        UserError: it says neither numbers nor dates, or no dates where there were some.
    """
    found = sample.clock(name)
    if found is None or (was is not None and was.dated and not found.dated):
        raise UserError(f"{sample.source}: {name} holds no {'dates' if was and was.dated else 'times'}; mend it")
    return replace(was, column=name) if was is not None and was.kind == found.kind == "text" else found


def _alike(name: str, kind: str, sample: Sample) -> None:
    """Refuse a column of another kind; of words among numbers the first is named when all rows are read."""
    what = sample.kinds[name]
    if what == "other" or what == "date" or (kind == "number" and sample.dated(name)):
        wanted = "numbers" if kind == "number" else "words"
        found = "dates" if what != "other" else "neither numbers nor words"
        raise UserError(f"{sample.source}: {name} holds {found}, and held {wanted} when the model was fitted; mend it")


class Match(Gaps):
    """How values of features differ from those that a model has seen, as chunks of rows come by."""

    def __init__(self, features: Features) -> None:
        super().__init__(features)
        self._strange: dict[str, tuple[Any, int, int]] = {}  # feature → first new value, its row, how many rows
        self._beyond: dict[str, tuple[int, float]] = {}  # feature → rows, and the value that is farthest away

    def add(self, frame: pd.DataFrame, rows: Ints, source: str) -> NDArray[np.bool_]:
        """Look at some rows; which of them stay [n]."""
        made = self._features.made(frame, rows)
        keep = self.kept(made, rows)
        for name, values in made.items():
            column = self._features.columns[name]
            if column.levels is None:
                self._range(name, np.asarray(values)[keep], column.least, column.most)
                continue
            series: Any = values
            strange = keep & (level_codes(series, column.levels) < 0) & series.notna().to_numpy()
            if strange.any():
                at = int(strange.argmax())
                value, row, count = self._strange.get(name, (series.iloc[at], int(rows[at]), 0))
                self._strange[name] = value, row, count + int(strange.sum())
        return keep

    def complete(self, source: str) -> None:
        """Refuse values of categories that no model has seen, and values that are missing.

        Raises:
            UserError: with value, row and what is known.
        """
        lines = []
        for name, (value, row, count) in self._strange.items():
            value = value.item() if isinstance(value, np.generic) else value
            more = f", and {count - 1} more rows have values like it" if count > 1 else ""
            known = nearest(str(value), map(str, self._features.columns[name].levels or ()))
            lines.append(f"{source}: {name} of row {row} is {value!r}, which the model has not seen{more}; {known}")
        if lines:
            raise UserError("\n".join([*lines, "leave these rows out, or recover anew with labels of such rows"]))
        super().complete(source)

    def beyond(self) -> list[str]:
        """A sentence on each number that leaves the range that was seen."""
        found = []
        for name, (count, value) in self._beyond.items():
            column = self._features.columns[name]
            found.append(
                f"{name} of {count} rows is outside of what was fitted ({column.least:g} to {column.most:g}), as far "
                f"as {value:g}"
            )
        return found

    def _range(self, name: str, values: Any, least: float, most: float) -> None:
        away = np.maximum(values - most, least - values)
        outside = away > 0
        if outside.any():
            count, farthest = self._beyond.get(name, (0, least))
            value = float(values[np.nanargmax(away)])
            if max(value - most, least - value) < max(farthest - most, least - farthest):
                value = farthest
            self._beyond[name] = count + int(outside.sum()), value

"""How rows are cut into windows: the columns of window, label, time and group, which are decided on together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from credit.core.errors import UserError
from credit.logged.tables import guesses
from credit.logged.tables.clock import Clock
from credit.logged.tables.guesses import Sample
from credit.logged.tables.second import in_second
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    import pandas as pd

STEP = ("step", "timestep", "t", "tick", "time")  # names of what counts the rows of a window


@dataclass(frozen=True)
class Cut:
    """Columns that cut.

    Attributes:
        window, label, time, group: as in `Roles`. clock: how `time` says it; without `time`: what orders the rows
            within each window alone.
    """

    window: str
    label: str
    time: str | None
    group: str | None
    clock: Clock | None = None


def cut(words: Words, sample: Sample, free: Sequence[str], labels: pd.DataFrame | None) -> Cut:
    """Decide on a sample of rows.

    Args:
        words: what a user said. free: columns of which nothing else was said. labels: the second table, if any.

    Raises:
        UserError: nothing fits, or several, or a time that is none.
    """
    states = words.states or ()
    time, group = guesses.series(sample, free, words.time, words.group, states)
    found = _second(words, sample, labels, time, group) if labels is not None else _rows(words, sample, time, group)
    if words.group is None and found.group is not None:
        found = _needed(words, sample, free, labels, found)
    window, time, group = found.window, found.time, found.group
    if group == window and words.group is None:  # a window that is its own series has nothing to carry on
        group = None
        if time and not words.time and not guesses.rises(sample, time, None):
            time = None
    if time == window and not words.time:
        time = None
    clock = sample.clock(time) if time else None
    if time and clock is None:
        raise UserError(f"{sample.source}: data.time={time} holds neither numbers nor dates; name another column")
    if clock is not None and restarts(sample, clock, group, window):
        time = None
    elif clock is None and words.time is None:
        names = [name for name in free if name not in (*states, window, found.label, group)]
        clock = _step(sample, names, group, window)
    return Cut(window, found.label, time, group, clock)


def restarts(sample: Sample, clock: Clock, group: str | None, window: str) -> bool:
    """Whether a time counts the rows of each window anew: it tells them apart there, and mixes windows in a group."""
    times = sample.frame[clock.column]
    if clock.kind != "number" or times.isna().any() or not guesses.whole(times):
        return False
    if int(sample.codes(group, window, clock.column).max()) + 1 < len(sample):
        return False
    own = sample.codes(group, window)[np.lexsort((np.asarray(times, dtype=np.float64), sample.codes(group)))]
    return int(np.count_nonzero(np.diff(own))) > int(own.max())


def _rows(words: Words, sample: Sample, time: str | None, group: str | None) -> Cut:
    window, label = guesses.windows(sample, _choice(words, sample), words.window, words.label, time, group)
    return Cut(window, label, time, group)


def _choice(words: Words, sample: Sample) -> list[str]:
    """Columns that may be windows or labels."""
    taken = {words.propensity, *words.cost.values(), *words.features}
    return [name for name in sample.kinds if name not in taken]


def _second(words: Words, sample: Sample, labels: pd.DataFrame, time: str | None, group: str | None) -> Cut:
    window, label, group = in_second(words, sample, labels, group)
    return Cut(window, label, time, group)


def _needed(words: Words, sample: Sample, free: Sequence[str], labels: pd.DataFrame | None, found: Cut) -> Cut:
    """The same without a guessed group, where windows that have a label each would be cut apart by it."""
    group, window, label = found.group, found.window, found.label
    if labels is not None:
        if group in labels.columns or not labels[window].is_unique or not _splits(sample, group, window):
            return found
    else:
        choice = _choice(words, sample)
        held = guesses.founded(sample, choice, words.window, words.label, found.time, group)
        if held and not (_splits(sample, group, window) and sample.single(label, sample.codes(window))):
            return found
        try:
            other = guesses.founded(sample, choice, words.window, words.label, found.time, None)
        except UserError:
            return found
        if other is None or not _splits(sample, group, other[0]):
            return found
        window, label = other
    time = found.time
    if words.time is None and not _in_turn(sample, time, window):
        time, _ = guesses.series(sample, free, None, False, words.states or ())
    return Cut(window, label, time, None)


def _splits(sample: Sample, group: str | None, window: str) -> bool:
    """Whether a group cuts windows apart."""
    return int(sample.codes(group, window).max()) > int(sample.codes(window).max())


def _in_turn(sample: Sample, time: str | None, window: str) -> bool:
    """Whether windows follow each other in the order of a time."""
    clock = sample.clock(time) if time else None
    if clock is None or sample.frame[clock.column].isna().any():
        return False
    times = clock(sample.frame[clock.column], np.arange(len(sample)), sample.source)
    own = sample.codes(window)[np.argsort(times, kind="stable")]
    return int(np.count_nonzero(np.diff(own))) == int(own.max())


def _step(sample: Sample, names: Sequence[str], group: str | None, window: str) -> Clock | None:
    """A column that by its name, and its values, counts the rows of each window."""
    called = [name for name in names if name.lower() in STEP and sample.kinds[name] == "number"]
    for name in sorted(called, key=lambda name: STEP.index(name.lower())):
        clock = sample.clock(name)
        if clock is not None and restarts(sample, clock, group, window):
            return clock
    return None

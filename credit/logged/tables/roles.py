"""Which column is what: as a user says, checked against the table, and guessed where nothing was said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError, nearest
from credit.logged.panel import LabelIs, Roles
from credit.logged.tables import choosing, guesses
from credit.logged.tables.clock import CALENDAR, Clock
from credit.logged.tables.columns import Kind
from credit.logged.tables.cutting import cut
from credit.logged.tables.guesses import Sample
from credit.logged.tables.proportional import left_out, sentences
from credit.logged.tables.words import BEHIND, Words

if TYPE_CHECKING:
    import pandas as pd


SERIES = 50  # at most, of which each has a level of its own where nothing is said of states


@dataclass(frozen=True)
class Settled:
    """What columns are.

    Attributes:
        roles: of each. clock: how the column of time says it, None where rows lie in order; where `roles.time` is none,
            it orders rows within their window alone. kinds: of each feature.
        dates: feature → what of a date it is. calendar: how their column says them. said: what was guessed.
    """

    roles: Roles
    clock: Clock | None
    kinds: Mapping[str, Kind]
    dates: Mapping[str, str]
    calendar: Clock | None
    said: tuple[str, ...]


def settled(words: Words, sample: Sample, labels: pd.DataFrame | None) -> Settled:
    """Decide on a sample of rows; what all rows must be is checked on all rows.

    Args:
        words: what a user said. labels: a second table with one row a window, if there is one.

    Raises:
        UserError: a column that is not there, or cannot be what it is said to be, or a question that nothing answers.
    """
    columns, source, said = [*sample.kinds], sample.source, []
    _there(words, columns, source, labels)
    taken = {words.window, words.label, words.propensity, *words.cost.values(), *(words.actions or ())}
    free = [name for name in columns if name not in taken]

    how = cut(words, sample, free, labels)
    window, label, time, group, clock = how.window, how.label, how.time, how.group, how.clock
    said += _guessed(words, window, label, time, group, clock)

    made, calendar = _calendar(words, sample, clock, columns)
    when = clock.column if clock else None
    used = {window, label, when, group, words.propensity, *words.cost.values(), *(words.next_states or ())}
    states, actions, more = _features(
        words, sample, [name for name in columns if name not in used], label, group, window
    )
    states = (*states, *made)
    said += more
    kinds: dict[str, Kind] = {}
    for name in (*actions, *states):
        if name in made:
            kinds[name] = "number" if CALENDAR[made[name]] is None else "category"
        else:
            kinds[name] = _usable(name, sample, {"data.window": window, "data.label": label})
    said += sentences(sample, [name for name in kinds if name not in made], actions)
    _about_actions(words, (*actions,), source)
    _about_features(words, states, (*actions, *states), source)
    for name in words.stock:
        if name not in kinds:
            raise UserError(f"{source}: data.stock names {name!r}, which is no feature; {nearest(name, kinds)}")
        if kinds[name] != "number":
            raise UserError(f"{source}: data.stock names {name!r}, which holds words; a level is a number")
    label_is = words.label_is or _label_is(sample if labels is None else Sample(labels, source), label)
    if not words.label_is and label_is == "binary":
        said.append(f"{label} is 0 or 1, and so the sum over a window is taken as log-odds (data.label_is=binary)")
    levels = [
        n for n in kinds if n not in words.stock and guesses.named(n, ("stock", "inventory", "level")) is not None
    ]
    if levels:
        said.append(
            f"{', '.join(levels)} may be a level, of which a window has a mean: say data.stock=[{', '.join(levels)}]"
        )
    roles = Roles(window, label, time, group, states, tuple(actions), words.stock, label_is, words.baseline, words.cost,
                  words.randomised, words.propensity, words.sizes, _behind(words, states, columns))  # fmt: skip
    return Settled(roles, clock, kinds, made, calendar, tuple(said))


def _there(words: Words, columns: Sequence[str], source: str, labels: pd.DataFrame | None) -> None:
    """Refuse names that no column has, and columns that would be two things at once."""
    singles = {"window": words.window, "time": words.time, "group": words.group, "propensity": words.propensity}
    if labels is None:
        singles["label"] = words.label
    for word, name in singles.items():
        if name and name not in columns:
            raise UserError(f"{source}: data.{word}={name}: there is no such column; {nearest(str(name), columns)}")
    several = {
        "states": words.states,
        "actions": words.actions,
        "cost": words.cost.values(),
        "next_states": words.next_states,
    }
    for word, names in several.items():
        for name in names or ():
            if name not in columns:
                raise UserError(
                    f"{source}: data.{word} names {name!r}: there is no such column; {nearest(name, columns)}"
                )
    for name in words.features:
        if name == words.label:
            raise UserError(
                f"{source}: {name} is the label, and among the features; a label explains itself: leave it out"
            )
        if name == words.window:
            raise UserError(f"{source}: {name} says the window, and is among the features; leave it out of one")
    if words.window and words.window == words.label:
        raise UserError(f"{source}: data.window and data.label are both {words.window!r}; name another column")


def _guessed(
    words: Words, window: str, label: str, time: str | None, group: str | None, clock: Clock | None
) -> list[str]:
    said = []
    if not words.window:
        said.append(f"data.window={window}: its rows share one value of the label")
    if not words.label:
        said.append(f"data.label={label}: it has one value in each window")
    if clock and not time:
        said.append(f"data.time={clock.column}: it begins anew in each {window}, and orders rows within it alone")
    elif words.time is None:
        what = (
            f"data.time={time}: it orders rows" if time else "rows are taken in the order in which they lie (data.time)"
        )
        said.append(what + (f" within each {group}" if time and group else ""))
    if words.group is None:
        said.append(f"data.group={group}: it tells series apart" if group else "all rows are one series (data.group)")
    return said


def _calendar(
    words: Words, sample: Sample, clock: Clock | None, columns: Sequence[str]
) -> tuple[dict[str, str], Clock | None]:
    """Features that dates become, by name."""
    if not words.calendar:
        return {}, None
    if clock is None or not clock.dated:
        other = next((name for name in columns if sample.dated(name)), None)
        clock = sample.clock(other) if other else None
    if clock is None:
        raise UserError(f"{sample.source}: data.calendar needs a column of dates such as 2024-01-31, and there is none")
    return {(f"{clock.column}_{what}" if what in columns else what): what for what in words.calendar}, clock


def _features(
    words: Words, sample: Sample, rest: Sequence[str], label: str, group: str | None, window: str
) -> tuple[tuple[str, ...], tuple[str, ...], list[str]]:
    """States and actions, and what was guessed of them."""
    if words.states is not None and words.actions is not None:
        return words.states, words.actions, []
    rest = [name for name in rest if name not in words.features]
    fit, said = choosing.features(sample, rest, label)
    copies = left_out(sample, words.features, fit)
    fit, said = [name for name in fit if name not in copies], [*said, *copies.values()]
    if words.actions is not None:
        said.append(f"data.states=[{', '.join(fit)}]: all that is not among the actions (data.states=[] for none)")
        return tuple(fit), words.actions, said
    if words.states is not None:
        said.append(f"data.actions=[{', '.join(fit)}]: all that is not among the states")
        return words.states, tuple(fit), said
    if not fit:
        raise UserError(f"{sample.source}: no column is left to be a state or an action; say data.actions=[…]")
    actions, why = choosing.actions(sample, fit)
    states = [name for name in fit if name not in actions]
    if group is not None and sample.kinds[group] == "category" and sample.levels(group) <= SERIES:
        states.append(group)  # what differs between series and lasts
    said.append(f"data.actions=[{', '.join(actions)}] data.states=[{', '.join(states)}]: {why}")
    return tuple(states), tuple(actions), said


def _usable(name: str, sample: Sample, used: Mapping[str, str]) -> Kind:
    """The kind of a feature.

    Raises:
        UserError: one that cannot be one.
    """
    for word, other in used.items():
        if name == other:
            raise UserError(f"{sample.source}: {name} is {word}, and among the features; leave it out")
    what = sample.kinds[name]
    if what == "other":
        raise UserError(
            f"{sample.source}: {name} holds neither numbers nor words; leave it out, or split it into columns"
        )
    if sample.dated(name):
        raise UserError(
            f"{sample.source}: {name} holds dates, which are no feature; say data.time={name} "
            "data.calendar=[weekday, month]"
        )
    return "number" if what == "empty" else what


def _about_actions(words: Words, actions: Sequence[str], source: str) -> None:
    for word, names in (("baseline", words.baseline), ("cost", words.cost), ("randomised", words.randomised)):
        for name in names:
            if name not in actions:
                raise UserError(f"{source}: data.{word} names {name!r}, which is no action; {nearest(name, actions)}")


def _about_features(words: Words, states: Sequence[str], features: Sequence[str], source: str) -> None:
    for name in words.sizes:
        if name not in features:
            raise UserError(f"{source}: data.sizes names {name!r}, which is no feature; {nearest(name, features)}")
    if words.next_states and len(words.next_states) != len(states):
        raise UserError(
            f"{source}: data.next_states names {len(words.next_states)} columns, and there are {len(states)} states "
            f"({', '.join(states)}); name one for each, in their order"
        )


def _behind(words: Words, states: Sequence[str], columns: Sequence[str]) -> tuple[str, ...]:
    """The columns of the states behind a step: as said, or called as the states with `next_` before."""
    if words.next_states is not None:
        return words.next_states
    named = tuple(f"{BEHIND}{name}" for name in states)
    return named if all(name in columns for name in named) else ()


def _label_is(sample: Sample, label: str) -> LabelIs:
    values = sample.frame[label].dropna()
    try:
        bits = np.isin(np.asarray(values, dtype=np.float64), (0, 1)).all()
    except (TypeError, ValueError):
        return "sum"  # refused with its row when all rows are read
    return "binary" if len(values) and bits else "sum"


def check_baseline(value: Any, name: str, levels: tuple[Any, ...] | None, source: str) -> Any:
    """What an effect of an action is counted from, as the action's own value.

    Raises:
        UserError: a word for a number, or a level that there is not.
    """
    if levels is None:
        try:
            return float(value)
        except (TypeError, ValueError):
            raise UserError(
                f"{source}: data.baseline of {name} is {value!r}; {name} is a number, and so must it be"
            ) from None
    found = next((level for level in levels if level == value or str(level) == str(value)), None)
    if found is None:
        raise UserError(f"{source}: data.baseline of {name} is {value!r}; {nearest(str(value), map(str, levels))}")
    return found

"""What a user may say of a table: the words `data.*`, checked for their form before the table is looked at."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from credit.core.errors import UserError, nearest
from credit.logged.panel import LabelIs
from credit.logged.tables.clock import CALENDAR

Missing = Literal["error", "drop", "mean"]
BEHIND = "next_"  # before the name of a state: that behind the step
NONE = (False, "false", "none")  # for group and time: there is none, and none is to be guessed


@dataclass(frozen=True)
class Words:
    """What was said, None where nothing was.

    Attributes:
        window, label, time, group, propensity: a column. time and group may be False: none, and do not guess.
        labels: a second table, one row a window. states, actions: columns; an empty list means none.
        stock, randomised: features. label_is, missing: one of those allowed. calendar: what becomes of dates.
        baseline: action → value. cost: action → column. sizes: feature that is a whole number → how many
            there are of it.
        next_states: the states behind each step, in the order of `states`. steps: of a window of a Minari dataset.
    """

    window: str | None = None
    label: str | None = None
    labels: Any = None
    time: str | Literal[False] | None = None
    group: str | Literal[False] | None = None
    states: tuple[str, ...] | None = None
    actions: tuple[str, ...] | None = None
    stock: tuple[str, ...] = ()
    label_is: LabelIs | None = None
    baseline: Mapping[str, Any] = field(default_factory=dict)
    cost: Mapping[str, str] = field(default_factory=dict)
    randomised: tuple[str, ...] = ()
    propensity: str | None = None
    missing: Missing = "error"
    calendar: tuple[str, ...] = ()
    sizes: Mapping[str, int] = field(default_factory=dict)
    next_states: tuple[str, ...] | None = None
    steps: int | None = None

    @property
    def features(self) -> tuple[str, ...]:
        """Those that were named."""
        return (*(self.actions or ()), *(self.states or ()))

    @classmethod
    def of(cls, given: Mapping[str, Any] | None) -> Words:
        """Check plain values; a list may be a string with commas.

        Raises:
            UserError: an unknown word, or a value of another form.
        """
        found: dict[str, Any] = {}
        known = [item.name for item in fields(cls)]
        for word, value in (given or {}).items():
            if word not in known:
                raise UserError(f"data.{word}: there is no such word; {nearest(str(word), known)}")
            if value is not None:
                found[word] = _checked(word, value)
        both = sorted({*found.get("states", ())} & {*found.get("actions", ())})
        if both:
            raise UserError(f"{both[0]!r} is in data.states and in data.actions; leave it in one of them")
        return cls(**found)


def _checked(word: str, value: Any) -> Any:
    if word in ("time", "group") and value in NONE:
        return False
    if word == "labels":
        return value
    if word in ("states", "actions", "stock", "randomised", "calendar", "next_states"):
        names = _names(word, value)
        if word == "calendar":
            for name in names:
                if name not in CALENDAR:
                    raise UserError(f"data.calendar: no date becomes {name!r}; {nearest(name, CALENDAR)}")
        return names
    if word == "steps":
        if not _count(value):
            raise UserError(f"data.steps is {value!r}; it must be a whole number, 1 or more")
        return value
    if word in ("baseline", "cost", "sizes"):
        if not isinstance(value, Mapping):
            raise UserError(f"data.{word} is {value!r}; it must be a mapping such as {{tv: 0}}, by action")
        for name, item in value.items() if word == "sizes" else ():
            if not _count(item):
                raise UserError(f"data.sizes of {name} is {item!r}; it must be a whole number, 1 or more")
        return {str(name): item for name, item in value.items()}
    allowed = {"label_is": get_args(LabelIs), "missing": get_args(Missing)}.get(word)
    if allowed and value not in allowed:
        raise UserError(f"data.{word}={value}: {nearest(str(value), allowed)}")
    if not isinstance(value, str | int) or isinstance(value, bool):
        raise UserError(f"data.{word} is {value!r}; it must be the name of one column")
    return value if allowed else str(value)


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _names(word: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        value = [name for name in (part.strip() for part in value.strip("[] ").split(",")) if name]
    if isinstance(value, Mapping) or not isinstance(value, Iterable):
        raise UserError(f"data.{word} is {value!r}; it must be a list such as [a, b]")
    names = tuple(str(name) for name in value)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"data.{word} names {twice!r} twice")
    return names

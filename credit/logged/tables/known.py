"""What is known of a table's columns: enough to read another table in the same way, without guesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, get_args

from credit.logged.panel import Column, LabelIs, Roles, plain
from credit.logged.tables.clock import Clock
from credit.logged.tables.columns import Kind
from credit.logged.tables.words import Missing

LISTS = ("states", "actions", "stock", "randomised", "next_states")  # of roles


@dataclass(frozen=True)
class Known:
    """How a table was read.

    Attributes:
        roles: what its columns are. clock: how the column of time says it; None where rows lie in order. kinds: of
            each feature. dates: feature → what of a date it is. calendar: how their column says them. missing: what
            is done where a feature has no value. columns: what all rows said of each feature.
    """

    roles: Roles
    clock: Clock | None
    kinds: Mapping[str, Kind]
    dates: Mapping[str, str]
    calendar: Clock | None
    missing: Missing
    columns: Mapping[str, Column]

    @property
    def needed(self) -> tuple[str, ...]:
        """Columns of a table that features are made of."""
        own = [name for name in self.kinds if name not in self.dates]
        return (*dict.fromkeys([*own, *([self.calendar.column] if self.dates and self.calendar else [])]),)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, texts and numbers, from which `from_dict` makes it; what JSON does not know is text."""
        found: dict[str, Any] = plain(asdict(self))
        return found | {"columns": [one.to_dict() for one in self.columns.values()]}

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Known:
        """What was saved.

        Raises:
            KeyError, TypeError, ValueError: it is no such thing.
        """
        given: dict[str, Any] = dict(saved["roles"])
        roles = Roles(**given | {name: tuple(given[name]) for name in LISTS})
        if roles.label_is not in get_args(LabelIs) or saved["missing"] not in get_args(Missing):
            raise ValueError(f"label_is is {roles.label_is!r}, missing {saved['missing']!r}")
        columns = {one["name"]: Column.from_dict(one) for one in saved["columns"]}
        if set(saved["kinds"]) != set(columns):
            raise ValueError("its features have no columns")
        clock, calendar = (Clock(**one) if one else None for one in (saved["clock"], saved["calendar"]))
        return cls(roles, clock, dict(saved["kinds"]), dict(saved["dates"]), calendar, saved["missing"], columns)

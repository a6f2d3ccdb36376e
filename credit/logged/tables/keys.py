"""Windows: who belongs to which, in what order, and what each is called for ever."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Ints, Roles, Windows
from credit.logged.tables.columns import codes, numbers

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.tables.clock import Clock


class Split(UserError):
    """A window whose rows do not follow each other."""


class Runs:
    """Stretches of rows that share group and window, as chunks of rows come by.

    Attributes:
        ordered: whether groups have stayed together and time has not fallen so far. tied: rows with group, window and
            time of the row before, as places in the order.

    Args:
        roles: columns that say it. clock: what makes numbers of times; without `roles.time` they begin anew in each
            window, and order its rows alone. source: for messages.
    """

    def __init__(self, roles: Roles, clock: Clock | None, source: str, labelled: bool = True) -> None:
        self.roles, self._clock, self._source, self._labelled = roles, clock, source, labelled
        self._within = clock is not None and roles.time is None
        self.ordered = True
        self.groups: dict[Any, int] = {}
        self._lists: dict[str, list[NDArray[Any]]] = {
            name: [] for name in ("id", "group", "time", "steps", "low", "high", "row", "joined")
        }
        self._last: tuple[int, Any, Any] | None = None
        self._tied: list[Ints] = []
        self.rows = 0

    @property
    def columns(self) -> list[str]:
        """Columns that are needed."""
        roles = self.roles
        time = self._clock.column if self._clock else roles.time
        named = [roles.window or None, roles.group, time, roles.label if self._labelled else None]
        return [*dict.fromkeys(name for name in named if name is not None)]

    def add(self, frame: pd.DataFrame, rows: Ints) -> None:
        """Look at some rows.

        Raises:
            UserError: no window, group or time in a row, a label that is no number, labels that differ.
        """
        roles = self.roles
        window, ids = np.arange(len(rows)), rows
        if roles.window:
            window, ids = self._present(frame[roles.window], rows, "window")
        group = np.zeros(len(rows), dtype=np.int64)
        if roles.group is not None:
            local, names = self._present(frame[roles.group], rows, "group")
            group = np.array([self.groups.setdefault(name, len(self.groups)) for name in names.tolist()])[local]
        clock = self._clock
        time = clock(frame[clock.column], rows, self._source) if clock else np.zeros(len(rows))
        label = np.full(len(rows), np.nan)
        if self._labelled:
            label = numbers(frame[roles.label], rows, self._source, "the label")

        new_group, new = np.empty(len(rows), dtype=bool), np.empty(len(rows), dtype=bool)
        np.not_equal(group[1:], group[:-1], out=new_group[1:])
        new[1:] = new_group[1:] | (window[1:] != window[:-1])
        fallen = np.zeros(len(rows), dtype=bool)
        fallen[1:] = ~(new if self._within else new_group)[1:] & (time[1:] < time[:-1])
        same = np.zeros(len(rows), dtype=bool)
        same[1:] = ~new[1:] & (time[1:] == time[:-1])
        new_group[0] = new[0] = True
        joined = False
        if self._last is not None:
            before, name, moment = self._last
            new_group[0] = group[0] != before
            joined = bool(not new_group[0] and ids[window[0]] == name)
            fallen[0] = (joined if self._within else not new_group[0]) and time[0] < moment
            same[0] = joined and time[0] == moment
        self._last = int(group[-1]), ids[window[-1]], time[-1]
        starts = np.flatnonzero(new)
        flags = np.zeros(len(starts), dtype=bool)
        flags[0] = joined
        self.ordered &= not fallen.any()
        if clock:
            self._tied.append(np.flatnonzero(same) + self.rows)
        found = {
            "id": ids[window[starts]],
            "group": group[starts],
            "time": time[starts],
            "steps": np.diff(starts, append=len(rows)),
            "low": np.fmin.reduceat(label, starts),
            "high": np.fmax.reduceat(label, starts),
            "row": rows[starts],
            "joined": flags,
        }
        for key, values in found.items():
            self._lists[key].append(values)
        self.rows += len(rows)
        if self.ordered and roles.group is not None:
            self.ordered = self._together(group[new_group])

    def _present(self, values: pd.Series[Any], rows: Ints, what: str) -> tuple[Ints, NDArray[Any]]:
        found, levels = codes(values)
        if (found < 0).any():
            row = rows[int((found < 0).argmax())]
            raise UserError(
                f"{self._source}: {values.name} of row {row} is missing, and it says the row's {what}; fill it in, or "
                "leave the row out"
            )
        return found, levels

    def _together(self, entered: Ints) -> bool:
        """Whether groups that begin are new ones: they are numbered as they come."""
        high = getattr(self, "_entered", -1)
        if len(entered):
            self._entered = int(max(high, entered.max()))
        return bool((np.diff(entered, prepend=high) == 1).all())

    def tied(self) -> Ints:
        """Rows, in order, that have group, window and time of the one before."""
        return np.concatenate(self._tied) if self._tied else np.zeros(0, dtype=np.int64)

    def scattered(self) -> bool:
        """Whether a time that orders windows' own rows alone is of windows whose rows do not follow each other."""
        if not self._within:
            return False
        lists = {key: np.concatenate(self._lists[key]) for key in ("id", "group", "joined")}
        starts = np.flatnonzero(~lists["joined"])
        key = hashed(lists["id"][starts], lists["group"][starts], tuple(self.groups) or ("all",))
        return len(np.unique(key)) < len(key)

    def finished(self) -> tuple[Windows, Ints]:
        """All windows, with labels from the rows where there are some, and the first row of each.

        Raises:
            UserError: labels that differ within a window, or a window whose rows do not follow each other.
        """
        lists = {key: np.concatenate(values) for key, values in self._lists.items()}
        starts = np.flatnonzero(~lists["joined"])
        low, high = np.fmin.reduceat(lists["low"], starts), np.fmax.reduceat(lists["high"], starts)
        ids, group, rows = lists["id"][starts], lists["group"][starts], lists["row"][starts]
        groups = tuple(self.groups) if self.roles.group is not None else ("all",)
        apart = high > low
        if apart.any():
            at = int(apart.argmax())
            raise UserError(
                f"{self._source}: {self.roles.label} is {low[at]:g} and {high[at]:g} in rows of one window, "
                f"{self._called(ids[at], groups[group[at]])}, which begins in row {rows[at]}; a window has one label, "
                "in all of its rows, or in its last one with nothing (not 0) in the others. Or name another column by "
                "data.label, data.window or data.group"
            )
        key = hashed(ids, group, groups) if self.roles.window else rows.astype(np.uint64)
        self._whole(key, ids, group, groups, rows)
        steps = np.add.reduceat(lists["steps"], starts)
        if self._clock is None or self._within:  # its number in its group
            begins = np.flatnonzero(np.diff(group, prepend=-1))
            time = np.arange(len(group)) - np.repeat(begins, np.diff(begins, append=len(group)))
        else:
            _, time = np.unique(lists["time"][starts], return_inverse=True)
        return Windows(ids, group, groups, time.astype(np.int64), steps.astype(np.int64), low, key), rows

    def _whole(
        self, key: NDArray[np.uint64], ids: NDArray[Any], group: Ints, groups: Sequence[Any], rows: Ints
    ) -> None:
        order = np.argsort(key, kind="stable")
        twice = np.flatnonzero(key[order][1:] == key[order][:-1])
        if not len(twice):
            return
        at = int(order[twice + 1].min())  # the first that comes again
        first = int(np.flatnonzero(key == key[at])[0])
        named = " and its time" if self._clock else ""
        word = "" if self.roles.window.lower() == "window" else "window "
        hints = [] if self.roles.group else ["name the column that tells series apart by data.group"]
        hints += ["leave data.time out"] if self._clock else ["name the column that orders rows by data.time"]
        raise Split(
            f"{self._source}: the rows of {word}{self._called(ids[at], groups[group[at]])} do not follow each other: "
            f"it begins in row {rows[first]}, and again in row {rows[at]}, with others in between (in the order of its "
            f"group{named}); give each window a name of its own, or {', or '.join(hints)}"
        )

    def _called(self, name: Any, group: Any) -> str:
        return f"{self.roles.window} {name}" + (f" of {self.roles.group} {group}" if self.roles.group else "")


def texts(values: NDArray[Any]) -> NDArray[Any]:
    """Names as text, the same whatever file they came from: 3, 3.0 and "3", or a date with and without midnight."""
    import pandas as pd

    some = pd.Series(values)
    some = some.infer_objects() if some.dtype == object else some
    if some.dtype.kind == "f":
        return some.astype("str").str.removesuffix(".0").to_numpy(dtype=object)
    if some.dtype.kind == "M" or pd.api.types.infer_dtype(some) in ("date", "datetime"):
        return some.astype("str").str.removesuffix(" 00:00:00").to_numpy(dtype=object)
    return some.astype("str").to_numpy(dtype=object)


def hashed(ids: NDArray[Any], group: Ints, groups: Sequence[Any]) -> NDArray[np.uint64]:
    """A number of 64 bits for each window's name and group: the same in any shard, order and machine [W]."""
    import pandas as pd

    found, names = pd.factorize(ids)
    windows = pd.util.hash_array(texts(np.asarray(names)), categorize=False)[found]
    series = pd.util.hash_array(texts(np.array(groups, dtype=object)), categorize=False)[group]
    mixed = (windows ^ (series * np.uint64(0x9E3779B97F4A7C15) + (series >> np.uint64(29)))) * np.uint64(
        0xBF58476D1CE4E5B9
    )
    return np.asarray(mixed ^ (mixed >> np.uint64(31)), dtype=np.uint64)

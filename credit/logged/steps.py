"""Rows of a table as steps of a problem: what registered reward models look at.

Where there is one state and one action, and both are whole numbers (or categories), they are numbers there, too, so
that tabular models work. Else states are vectors in units of the table, with a 0 or 1 for each category, and actions
vectors in [−1, 1]: their amounts, scaled, and their categories.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Column, Floats, Ints, Panel, Part, Roles

if TYPE_CHECKING:
    from credit.core.problem import Problem
    from credit.core.steps import Steps

MOST = 100_000  # values of a whole number that is one of a table


@dataclass(frozen=True)
class Spaces:
    """How rows are steps.

    Attributes:
        roles: of columns. columns: what all rows say of them. sizes: how many states and actions there are, where both
            are numbers; None where they are vectors. window: rows of the longest window.
        even: whether all have as many.
    """

    roles: Roles
    columns: Mapping[str, Column]
    sizes: tuple[int, int] | None
    window: int
    even: bool

    @classmethod
    def of(cls, panel: Panel) -> Spaces:
        """Those of a table.

        Raises:
            UserError: a column of which `data.sizes` says how many values it has holds another one.
        """
        roles, lengths = panel.roles, panel.windows.steps
        pair = (*roles.states, *roles.actions) if len(roles.states) == len(roles.actions) == 1 else ()
        found = _counts(panel, pair) if pair else None
        if found is None and roles.sizes:
            named = ", ".join(roles.sizes)
            raise UserError(
                f"data.sizes ({named}): numbers of a table are one state and one action, both whole; here there are "
                f"{len(roles.states)} states and {len(roles.actions)} actions ({', '.join(roles.features)})"
            )
        return cls(roles, panel.columns, found, int(lengths.max()), bool((lengths == lengths[0]).all()))

    @property
    def widths(self) -> tuple[int, int]:
        """Numbers of a state and of an action."""
        if self.sizes is not None:
            return 1, 1
        states, actions = ([len(self.columns[name].levels or (0,)) for name in names] for names in self._names)
        return sum(states), sum(actions)

    @property
    def _names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        return self.roles.states, self.roles.actions

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers of a row's design: the state's, the action's, those of the state behind it, and the step."""
        states, actions = ([one for name in names for one in self._labels(name)] for names in self._names)
        return (*states, *actions, *(f"next {one}" for one in states), "step")

    def _labels(self, name: str) -> list[str]:
        levels = self.columns[name].levels
        return [name] if levels is None or self.sizes is not None else [f"{name}={level}" for level in levels]

    def problem(self, seeds: tuple[int, ...], window: int | None = None, whole: bool = True) -> Problem:
        """The problem in whose spaces rows lie, for R replicas.

        Args:
            seeds: one a replica. window: rows of the longest window, where it is not the table's. whole: whether all
                windows have labels.
        """
        from dataclasses import replace

        from gymnasium.spaces import Box

        from credit.core.problem import LabelKind, Problem

        rows = self.window if window is None else window
        if self.sizes is not None:
            found = Problem.finite(*self.sizes, rows, seeds, episodic=True)
        else:
            low, high = (np.array(bounds, dtype=np.float32) for bounds in self._bounds)
            found = replace(Problem.vectors(*self.widths, rows, seeds), observation_space=Box(low, high))
        labels: LabelKind = "bits" if self.roles.label_is == "binary" else "real"
        named = tuple(one for name in self.roles.states for one in self._labels(name))
        names = named if self.sizes is None and all(map(str.isidentifier, named)) else ()
        return replace(found, labels=labels, even=self.even and whole, names=names)

    @property
    def _bounds(self) -> tuple[list[float], list[float]]:
        """The least and the most of each number of a state that is a vector."""
        columns = [self.columns[name] for name in self.roles.states]
        pairs = [
            pair
            for one in columns
            for pair in ([(one.least, one.most)] if one.levels is None else [(0.0, 1.0)] * len(one.levels))
        ]
        return [low for low, _ in pairs], [high for _, high in pairs]

    @property
    def said(self) -> str:
        """What steps are, in words."""
        if self.sizes is not None:
            return f"a state is one of {self.sizes[0]}, an action one of {self.sizes[1]}"
        return "a state is {} numbers, an action {}".format(*self.widths)

    def design(self, part: Part, replaced: tuple[str, Any] | None = None) -> Floats:
        """The numbers of rows [n, F], `names` says which.

        Args:
            part: of the rows, whole windows. replaced: a feature and the value that it has in all of them.
        """
        states, actions = self._side(part, self.roles.states, replaced), self._side(part, self.roles.actions, replaced)
        step = np.arange(len(part)) - np.repeat(part.starts, np.diff(np.append(part.starts, len(part))))
        return np.concatenate([states, actions, self._behind(part, states), step[:, None].astype(np.float64)], axis=1)

    def steps(self, design: Floats) -> Steps:
        """Rows [n, F] as steps [n]."""
        import torch

        from credit.core.steps import Steps

        first, second = self.widths[0], sum(self.widths)
        cut = (design[:, :first], design[:, first:second], design[:, second:-1])
        if self.sizes is not None:
            states, actions, behind = (torch.from_numpy(part[:, 0].astype(np.int64)) for part in cut)
        else:
            states, actions, behind = (torch.from_numpy(np.ascontiguousarray(part, dtype=np.float32)) for part in cut)
        return Steps(states, actions, behind, torch.from_numpy(design[:, -1].astype(np.int64)))

    def _side(self, part: Part, names: tuple[str, ...], replaced: tuple[str, Any] | None) -> Floats:
        blocks = [self._block(part, name, replaced) for name in names]
        return np.concatenate(blocks, axis=1) if blocks else np.zeros((len(part), 0))

    def _block(self, part: Part, name: str, replaced: tuple[str, Any] | None) -> Floats:
        """What a feature is in a design [n, k]."""
        column = self.columns[name]
        if replaced is not None and replaced[0] == name:
            value = replaced[1]
            if column.levels is not None:
                codes = np.full(len(part), list(column.levels).index(value))
            else:
                values = np.full(len(part), float(value))
        elif column.levels is not None:
            codes = part.frame[name].cat.codes.to_numpy()
        else:
            values = part.frame[name].to_numpy(np.float64)
        if column.levels is not None:
            if self.sizes is not None:
                return _values(column)[codes][:, None].astype(np.float64)
            return np.asarray(np.arange(len(column.levels)) == codes[:, None], dtype=np.float64)
        if self.sizes is None and name in self.roles.actions:
            low, high = self._range(column)
            values = 2 * (values - low) / (high - low) - 1 if high > low else np.zeros(len(part))
        return values[:, None]

    def _range(self, column: Column) -> tuple[float, float]:
        """What becomes −1 and 1: the least and the most of an action, its baseline within."""
        base = float(self.roles.baseline.get(column.name, 0.0))
        return min(column.least, base), max(column.most, base)

    def _behind(self, part: Part, states: Floats) -> Floats:
        """The states behind the steps [n, O]: as the table says, or those of the next row of the same group."""
        names = self.roles.next_states
        numbers = self.sizes is not None or all(self.columns[name].levels is None for name in self.roles.states)
        if names and numbers and all(name in part.frame for name in names):
            return part.frame[list(names)].to_numpy(np.float64)
        found = states.copy()
        same = np.diff(part.group) == 0
        found[:-1][same] = states[1:][same]
        return found

    @property
    def tells_next(self) -> bool:
        """Whether the table says what was behind each step."""
        return bool(self.roles.next_states)


def rows_of(panel: Panel, spaces: Spaces, largest: int) -> Floats:
    """The design of all rows [n, F].

    Raises:
        UserError: they are more than `largest` numbers.
    """
    if (count := panel.rows * len(spaces.names)) > largest:
        raise UserError(
            f"{panel.source}: {panel.rows} rows of {len(spaces.names)} numbers are {count:.1e}, and registered reward "
            f"models hold at most {largest:.0e} in memory; use formulas, which read a table in parts, fewer columns, "
            "or fewer windows"
        )
    return np.concatenate(list(_designs(panel, spaces)))


def _designs(panel: Panel, spaces: Spaces) -> Iterator[Floats]:
    for part in panel.parts():
        yield spaces.design(part)


def _values(column: Column) -> Ints:
    """The number of each level of a category: itself, where all are whole numbers."""
    levels = column.levels or ()
    whole = all(isinstance(level, int | np.integer) and not isinstance(level, bool) and level >= 0 for level in levels)
    return np.array(levels if whole else np.arange(len(levels)), dtype=np.int64)


def _counts(panel: Panel, names: tuple[str, ...]) -> tuple[int, int] | None:
    """How many values a state and an action have, where both are whole numbers; else None."""
    said, most = panel.roles.sizes, []
    plain = [name for name in names if panel.columns[name].levels is None]
    for name in names:
        column = panel.columns[name]
        least, last = (column.least, column.most) if name in plain else (0, int(_values(column).max()))
        if least < 0 or last >= MOST:
            return None
        most.append(int(last) + 1)
    if plain and not all(_whole(part, plain) for part in panel.parts()):
        return None
    for at, name in enumerate(names):
        if name in said:
            if most[at] > said[name]:
                raise UserError(
                    f"{panel.source}: {name} is {most[at] - 1} in a row, and data.sizes says 0 to {said[name] - 1}"
                )
            most[at] = said[name]
    return most[0], most[1]


def _whole(part: Part, names: list[str]) -> bool:
    values = part.frame[names].to_numpy(np.float64)
    return bool((values == np.floor(values)).all())

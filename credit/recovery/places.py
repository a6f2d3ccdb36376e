"""Where a pseudo-reward is defined: the cells of a table, or the steps that were taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Look, Places
from credit.core.steps import Steps
from credit.core.store import Store, put
from credit.core.tensors import grown
from credit.core.windows import Windows


class Table(Places):
    """The cells of a table that all models look at.

    Args:
        problem: sizes. cells: what they are.
    """

    keeps: ClassVar = ("_visits",)

    def __init__(self, problem: Problem, cells: Cells) -> None:
        self.cells: Cells = cells
        self.steps = cells.steps(problem.device)
        self._visits = problem.zeros(cells.count)
        self._newest: tuple[Windows, Tensor] | None = None  # and the cells of their rows: all models ask for them

    def look(self, features: Callable[[Steps], Tensor]) -> TableLook:
        """φ of all cells, once."""
        return TableLook(self, features(self.steps))

    def extend(self, store: Store) -> None:
        """Count visits."""
        self._newest = store.new, self.cells.index(store.new)
        self._visits.scatter_add_(1, self._newest[1], store.new.once)

    def index(self, windows: Windows) -> Tensor:
        """The cell of every row [R, n]."""
        if self._newest is not None and windows is self._newest[0]:
            return self._newest[1]
        return self.cells.index(windows)

    @property
    def visits(self) -> Tensor:
        """N(s, a) [R, N]."""
        return self._visits


class TableLook(Look):
    """φ of all cells [N, d]."""

    keeps: ClassVar = ()

    def __init__(self, cells: Table, table: Tensor) -> None:
        self._cells, self.table = cells, table

    def places(self, at: Tensor | None = None) -> Tensor:
        """φ of some cells [R, n, d], or of all [N, d]."""
        return self.table if at is None else self.table[at]

    def rows(self, windows: Windows, newest: bool) -> Tensor:
        """φ of every row [R, n, d]."""
        return self.table[self._cells.index(windows)]


class Rows(Places):
    """The steps that were taken, in the order in which they came: place n of a replica is its n-th row."""

    keeps: ClassVar = ("_looks", "_counts", "_before")

    def __init__(self, problem: Problem) -> None:
        self._looks: list[RowLook] = []
        self._counts, self._before = [0] * problem.replicas, [0] * problem.replicas
        self._store: Store | None = None  # whose rows they are, since the last of them came

    def look(self, features: Callable[[Steps], Tensor]) -> RowLook:
        """φ of all rows to come."""
        self._looks.append(RowLook(features))
        return self._looks[-1]

    def extend(self, store: Store) -> None:
        """Compute φ of the newest rows, once."""
        self._store, new = store, store.new
        added = [len(new)] * len(self._counts) if new.count is None else new.count.tolist()
        self._before, self._counts = self._counts, [sum(pair) for pair in zip(self._counts, added, strict=True)]
        for look in self._looks:
            look.extend(new, self._before, added)

    def index(self, windows: Windows) -> Tensor:
        """The row itself, or where the newest rows went [R, n].

        Raises:
            UserError: these are neither the newest windows nor all.
        """
        row, shape = torch.arange(len(windows), device=windows.labels.device), windows.states.shape[:2]
        if len(windows) == max(self._counts) and (self._store is None or _same(windows, self._store.windows)):
            return row.expand(shape)
        newest = max(now - then for now, then in zip(self._counts, self._before, strict=True))
        if len(windows) != newest or not (self._store is None or _same(windows, self._store.new)):
            raise UserError(
                f"these {len(windows)} rows are neither all {max(self._counts)} that were learned from nor the newest "
                f"{newest}, and each has its own reward; ask `believe(steps)` about other steps"
            )
        found = row + torch.tensor(self._before, device=row.device).unsqueeze(1)
        return found.clamp(max=max(self._counts) - 1)  # rows that mean nothing stand behind a replica's last

    @property
    def counts(self) -> list[int]:
        """Rows of each replica."""
        return self._counts


def _same(one: Windows, other: Windows) -> bool:
    """Whether windows have the same rows; at a glance where they lie in the same memory."""
    if one.states.data_ptr() == other.states.data_ptr():
        return True
    return torch.equal(one.states, other.states) and torch.equal(one.actions, other.actions)


class RowLook(Look):
    """φ of the rows that came so far [R, N, d], with room for more."""

    keeps: ClassVar = ("_column", "_rows")

    def __init__(self, features: Callable[[Steps], Tensor]) -> None:
        self._features = features
        self._column = torch.zeros(0, 0)
        self._rows = 0
        self._new = self._column

    def filled(self) -> Mapping[str, int]:
        """As many columns as rows."""
        return {"_column": self._rows}

    def extend(self, new: Windows, starts: Sequence[int], counts: Sequence[int]) -> None:
        """Append φ of windows."""
        self._new = self._features(new)
        self._rows = max(map(sum, zip(starts, counts, strict=True)))
        if not self._column.numel():
            self._column = self._new.new_zeros(len(self._new), self._rows, *self._new.shape[2:])
        elif self._rows > self._column.shape[1]:
            self._column = grown(self._column, self._rows)
        put(self._column, self._new, starts, counts)

    def places(self, at: Tensor | None = None) -> Tensor:
        """φ of some rows [R, n, d], or of all."""
        column = self._column[:, : self._rows]
        return column if at is None else column.gather(1, at.unsqueeze(-1).expand(*at.shape, column.shape[-1]))

    def rows(self, windows: Windows, newest: bool) -> Tensor:
        """φ of the newest rows, or of all."""
        return self._new if newest else self.places()

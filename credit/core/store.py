"""Labelled windows: one store for every problem, replica-major."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from credit.core.checks import check_windows
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.state import Stateful
from credit.core.tensors import grown
from credit.core.windows import Windows


def put(block: Tensor, part: Tensor, starts: Sequence[int], counts: Sequence[int]) -> None:
    """Write the first rows of each replica of a part [R, n, ...] into a block [R, ≥ start + count, ...], in place."""
    for own, new, start, count in zip(block, part, starts, counts, strict=True):
        own[start : start + count] = new[:count]


ROWS = ("states", "actions", "next_states", "step", "ended", "terminated", "primitive")  # columns of a row


EMPTY = "this store has no windows yet: append some first"


class Store(Stateful):
    """All labelled windows of R replicas; `new` are those of the last append, `windows` all of them, as views.

    Args:
        problem: gives R and the device.
        rows: to reserve room for in each replica; it grows when that is not enough.
    """

    def __init__(self, problem: Problem, rows: int = 0) -> None:
        self._problem, self._room, self._device = problem, max(rows, 1), problem.device
        self._columns: dict[str, Tensor] = {}  # [R, room, ...]
        self._labels = problem.zeros(1)
        self._labelled = torch.ones(problem.replicas, 1, dtype=torch.bool, device=problem.device)
        self._partial = False  # whether a window has no label
        self._last = torch.zeros(problem.replicas, 1, dtype=torch.int64, device=problem.device)
        self._rows = torch.zeros(problem.replicas, dtype=torch.int64)  # of each replica
        self._level: int | None = 0  # the same, where all replicas have as many: what the hot path asks for
        self._windows, self._length = 0, -1  # K; T, 0 where windows differ, −1 as long as there are none
        self._new: Windows | None = None
        self.before = self._rows  # rows of each replica before the last append [R]
        self.taken = 0  # steps that led to the last append, of the replica that took the most

    def __len__(self) -> int:
        """K."""
        return self._windows

    def append(self, windows: Windows, checked: bool = False, taken: int | None = None) -> None:
        """Add windows; they are `new` until the next append. There may be none.

        Args:
            windows: K of them for every replica. checked: whether somebody made sure that they fit the problem.
            taken: steps that each replica took for them, where that is not their rows: a window may still be open.

        Raises:
            UserError: a label is not finite, or a state or an action is not one of the problem's.
            ValueError: these have columns, or a length, that those before do not have, or the other way round.
        """
        if not checked:
            check_windows(windows, self._problem)
        columns = {name: part for name in ROWS if (part := getattr(windows, name)) is not None}
        length = windows.length or 0
        if self._length >= 0 and (columns.keys() != self._columns.keys() or length != self._length):
            raise ValueError(
                f"a store holds windows of one kind: {sorted(self._columns)} with length {self._length}, and these "
                f"have {sorted(columns)} with length {length}"
            )
        self._length = length
        self.before = self._rows
        self.taken = len(windows) if taken is None else taken
        added = len(windows) if windows.count is None else windows.count.cpu()
        rows = self._rows + added
        level = self._level if windows.count is None else None
        first, stop = (0, int(rows.max())) if level is None else (level, level + len(windows))
        for name, part in columns.items():
            block = self._columns.get(name)
            if block is None:
                block = part.new_zeros(len(part), max(self._room, stop), *part.shape[2:])
            elif stop > block.shape[1]:
                block = grown(block, stop)
            self._columns[name] = block
            if level is not None:
                block[:, first:stop] = part
            else:
                put(block, part, self._rows.tolist(), (rows - self._rows).tolist())
        self._add_labels(windows)
        self._rows, self._level = rows, _common(rows) if level is None else stop
        self._new = windows

    def _add_labels(self, windows: Windows) -> None:
        start, stop = self._windows, self._windows + windows.labels.shape[1]
        if stop > self._labels.shape[1]:
            self._labels, self._last = grown(self._labels, stop), grown(self._last, stop)
            self._labelled = grown(self._labelled, stop)
        self._labels[:, start:stop] = windows.labels
        self._labelled[:, start:stop] = True if windows.labelled is None else windows.labelled
        self._partial |= windows.labelled is not None
        if windows.length is None:
            self._last[:, start:stop] = windows.ends + self._rows.to(self._device).unsqueeze(1)
        self._windows = stop

    @property
    def new(self) -> Windows:
        """The windows of the last append.

        Raises:
            UserError: there was none.
        """
        if self._new is None:
            raise UserError(EMPTY)
        return self._new

    @property
    def windows(self) -> Windows:
        """All windows, as views.

        Raises:
            UserError: there were none.
        """
        if not self._columns:
            raise UserError(EMPTY)
        rows = int(self._rows.max()) if self._level is None else self._level
        columns: dict[str, Any] = {name: block[:, :rows] for name, block in self._columns.items()}
        columns["labels"] = self._labels[:, : self._windows]
        columns["labelled"] = self._labelled[:, : self._windows] if self._partial else None
        if self._length:
            return Windows(**columns, length=self._length)
        count = self._rows.to(self._device) if self._level is None else None
        return Windows(**columns, last=self._last[:, : self._windows], count=count)

    def state_dict(self) -> dict[str, Any]:
        """All windows, without the room for more."""
        rows = int(self._rows.max())
        return {
            "columns": {name: block[:, :rows].cpu().clone() for name, block in self._columns.items()},
            "labels": self._labels[:, : self._windows].cpu().clone(),
            "last": self._last[:, : self._windows].cpu().clone(),
            "labelled": self._labelled[:, : self._windows].cpu().clone() if self._partial else None,
            "rows": self._rows.clone(),
            "length": self._length,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Hold these windows and no others."""
        self._columns = {name: block.to(self._device) for name, block in state["columns"].items()}
        self._labels, self._last = state["labels"].to(self._device), state["last"].to(self._device)
        self._rows, self._length = state["rows"].cpu(), state["length"]
        self._windows, self._level = self._labels.shape[1], _common(self._rows)
        labelled = state.get("labelled")
        self._partial = labelled is not None
        ones = torch.ones_like(self._labels, dtype=torch.bool)
        self._labelled = ones if labelled is None else labelled.to(self._device)


def _common(rows: Tensor) -> int | None:
    """How many rows every replica has; None where they differ."""
    return int(rows[0]) if bool((rows == rows[0]).all()) else None

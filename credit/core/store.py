"""Labelled windows: one store for every problem, replica-major."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import torch
from torch import Tensor

from credit.core.checks import check_windows
from credit.core.problem import Problem
from credit.core.state import Stateful
from credit.core.steps import Steps
from credit.core.tensors import grown


class Episode(NamedTuple):
    """L steps from a beginning to an end: states, actions, next_states [L, ...], and whether nothing lies behind."""

    states: Tensor
    actions: Tensor
    next_states: Tensor
    terminated: bool = False


@dataclass(frozen=True, kw_only=True)
class Windows(Steps):
    """Labelled windows of R replicas, K each, over n rows of steps; a window's rows follow each other.

    Episodes and windows are two partitions of the same rows. Where all windows have T steps, `length` says so and
    nothing else needs to be kept; otherwise `last` does, and replicas with fewer rows than others have rows at their
    end that mean nothing.

    Attributes:
        labels: Y [R, K], all that a learner is told about a window.
        length: T, where every window has as many steps.
        last: the last row of each window [R, K] int64, rising; rows behind the last of them are in no window yet.
        ended: whether a row is the last of its episode [R, n]. terminated: whether nothing lies behind it [R, n].
        count: how many of its rows each replica has [R]; None for all.
        primitive: r [R, n], only for components that declare `sees_primitive` (the oracle); None for all others.
    """

    labels: Tensor
    length: int | None = None
    last: Tensor | None = None
    ended: Tensor | None = None
    terminated: Tensor | None = None
    count: Tensor | None = None
    primitive: Tensor | None = None

    @classmethod
    def of_grid(cls, states: Tensor, actions: Tensor, next_states: Tensor, labels: Tensor) -> Windows:
        """Windows of equal lengths: steps [R, K, T, ...] and labels [R, K]; memory is shared where it can be."""
        s, a, n = (part.flatten(1, 2) for part in (states, actions, next_states))
        return cls(s, a, n, labels=labels, length=states.shape[2])

    def to(self, device: torch.device | str) -> Windows:
        """The same windows elsewhere."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        moved: dict[str, Any] = {name: x.to(device) if isinstance(x, Tensor) else x for name, x in parts.items()}
        return Windows(**moved)

    @classmethod
    def of_episodes(cls, episodes: Sequence[Sequence[Episode]], labels: Tensor) -> Windows:
        """Windows that are whole episodes, of any lengths, the same number for every replica.

        Args:
            episodes: K episodes of each of R replicas. labels: [R, K].
        """
        lengths = torch.tensor([[len(episode.states) for episode in own] for own in episodes])
        count = lengths.sum(1)
        rows = int(count.max())

        def column(name: str) -> Tensor:
            parts = [torch.cat([getattr(episode, name) for episode in own]) for own in episodes]
            block = parts[0].new_zeros(len(parts), rows, *parts[0].shape[1:])
            for row, part in zip(block, parts, strict=True):
                row[: len(part)] = part
            return block.to(labels.device)

        last = lengths.cumsum(1) - 1
        ended = torch.zeros(len(episodes), rows, dtype=torch.bool).scatter(1, last, True)
        over = torch.tensor([[episode.terminated for episode in own] for own in episodes])
        step = [torch.cat([torch.arange(n) for n in own]) for own in lengths.tolist()]
        return cls(
            column("states"),
            column("actions"),
            column("next_states"),
            step=torch.nn.utils.rnn.pad_sequence(step, batch_first=True).to(labels.device),
            labels=labels,
            last=last.to(labels.device),
            ended=ended.to(labels.device),
            terminated=torch.zeros_like(ended).scatter(1, last, over).to(labels.device),
            count=None if (count == rows).all() else count.to(labels.device),
        )

    @property
    def times(self) -> Tensor:
        """The step in the episode, or in the window where that is not kept, counted from 0 [R, n]."""
        if self.step is not None or self.length is None:
            return super().times
        row = torch.arange(len(self), device=self.states.device)
        return (row % self.length).expand(self.states.shape[:2])

    @property
    def ends(self) -> Tensor:
        """The last row of each window [R, K]."""
        if self.last is not None:
            return self.last
        assert self.length is not None
        number = torch.arange(self.labels.shape[1], device=self.labels.device)
        return (self.length * (number + 1) - 1).expand(self.labels.shape)

    @property
    def lengths(self) -> Tensor:
        """Steps of each window [R, K]."""
        return torch.diff(self.ends, dim=1, prepend=torch.full_like(self.ends[:, :1], -1))

    @property
    def number(self) -> Tensor:
        """Which window each row is in [R, n]; K where in none."""
        row = torch.arange(len(self), device=self.labels.device)
        if self.length is not None:
            return (row // self.length).expand(self.states.shape[:2])
        return torch.searchsorted(self.ends.contiguous(), row.repeat(len(self.labels), 1))

    @property
    def final(self) -> Tensor:
        """Whether a row is the last of its window [R, n]."""
        if self.length is not None:
            row = torch.arange(len(self), device=self.labels.device)
            return (row % self.length == self.length - 1).expand(self.states.shape[:2])
        return torch.zeros(self.states.shape[:2], dtype=torch.bool, device=self.labels.device).scatter(
            1, self.ends, True
        )

    @property
    def valid(self) -> Tensor | None:
        """Which rows mean something [R, n]; None for all."""
        if self.count is None:
            return None
        return torch.arange(len(self), device=self.count.device) < self.count.unsqueeze(1)

    def grid(self, values: Tensor) -> Tensor:
        """What rows have [R, n, ...], as [R, K, T, ...] in the same memory; only where all windows have T steps."""
        assert self.length is not None, "windows of different lengths have no grid"
        return values.unflatten(1, (-1, self.length))

    def to_steps(self, values: Tensor) -> Tensor:
        """What a window has [R, K], for each of its rows [R, n]; 0 for rows that are in none."""
        if self.length is not None:
            return values.repeat_interleave(self.length, dim=1)
        padded = torch.nn.functional.pad(values, (0, 1))
        return padded.gather(1, self.number)

    def sums(self, values: Tensor) -> Tensor:
        """Sums [R, K, ...] over the rows of each window, of values [R, n, ...]."""
        if self.length is not None:
            return self.grid(values).sum(2)
        replicas, windows = self.labels.shape
        place = self.number + (windows + 1) * torch.arange(replicas, device=values.device).unsqueeze(1)
        total = values.new_zeros(replicas * (windows + 1), *values.shape[2:])
        total.index_add_(0, place.flatten(), values.flatten(0, 1))
        return total.unflatten(0, (replicas, windows + 1))[:, :windows]


def put(block: Tensor, part: Tensor, starts: Sequence[int], counts: Sequence[int]) -> None:
    """Write the first rows of each replica of a part [R, n, ...] into a block [R, ≥ start + count, ...], in place."""
    for own, new, start, count in zip(block, part, starts, counts, strict=True):
        own[start : start + count] = new[:count]


ROWS = ("states", "actions", "next_states", "step", "ended", "terminated", "primitive")  # columns of a row


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
        self._last = torch.zeros(problem.replicas, 1, dtype=torch.int64, device=problem.device)
        self._rows = torch.zeros(problem.replicas, dtype=torch.int64)  # of each replica
        self._windows, self._length = 0, -1  # K; T, 0 where windows differ, −1 as long as there are none
        self.new: Windows
        self.before = self._rows  # rows of each replica before the last append [R]

    def __len__(self) -> int:
        """K."""
        return self._windows

    def append(self, windows: Windows, checked: bool = False) -> None:
        """Add windows; they are `new` until the next append. There may be none.

        Args:
            windows: K of them for every replica. checked: whether somebody made sure that they fit the problem.

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
        self.before = self._rows.clone()
        added = torch.full_like(self._rows, len(windows)) if windows.count is None else windows.count.cpu()
        even = windows.count is None and bool((self._rows == self._rows[0]).all())
        first, stop = int(self._rows.max()) if even else 0, int((self._rows + added).max())
        for name, part in columns.items():
            block = self._columns.get(name)
            if block is None:
                block = part.new_zeros(len(part), max(self._room, stop), *part.shape[2:])
            elif stop > block.shape[1]:
                block = grown(block, stop)
            self._columns[name] = block
            if even:
                block[:, first:stop] = part
            else:
                put(block, part, self._rows.tolist(), added.tolist())
        self._add_labels(windows)
        self._rows = self._rows + added
        self.new = windows

    def _add_labels(self, windows: Windows) -> None:
        start, stop = self._windows, self._windows + windows.labels.shape[1]
        if stop > self._labels.shape[1]:
            self._labels, self._last = grown(self._labels, stop), grown(self._last, stop)
        self._labels[:, start:stop] = windows.labels
        if windows.length is None:
            self._last[:, start:stop] = windows.ends + self._rows.to(self._device).unsqueeze(1)
        self._windows = stop

    @property
    def windows(self) -> Windows:
        """All windows, as views."""
        rows = int(self._rows.max())
        columns: dict[str, Any] = {name: block[:, :rows] for name, block in self._columns.items()}
        labels = self._labels[:, : self._windows]
        if self._length:
            return Windows(**columns, labels=labels, length=self._length)
        ragged = bool((self._rows != rows).any())
        count = self._rows.to(self._device) if ragged else None
        return Windows(**columns, labels=labels, last=self._last[:, : self._windows], count=count)

    def state_dict(self) -> dict[str, Any]:
        """All windows, without the room for more."""
        rows = int(self._rows.max())
        return {
            "columns": {name: block[:, :rows].cpu().clone() for name, block in self._columns.items()},
            "labels": self._labels[:, : self._windows].cpu().clone(),
            "last": self._last[:, : self._windows].cpu().clone(),
            "rows": self._rows.clone(),
            "length": self._length,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Hold these windows and no others."""
        self._columns = {name: block.to(self._device) for name, block in state["columns"].items()}
        self._labels, self._last = state["labels"].to(self._device), state["last"].to(self._device)
        self._rows, self._length = state["rows"].cpu(), state["length"]
        self._windows = self._labels.shape[1]

"""Labelled windows: rows of steps, and which of them share a label."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.steps import Steps


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
    end that mean nothing. Replicas with fewer windows than others have some without a row and without a label.

    Attributes:
        labels: Y [R, K], all that a learner is told about a window; 0 where it has none.
        labelled: whether it has a label [R, K]; None where all have.
        length: T, where every window has as many steps.
        last: the last row of each window [R, K] int64, rising; rows behind the last of them are in no window yet.
        ended: whether a row is the last of its episode [R, n]. terminated: whether nothing lies behind it [R, n].
        count: how many of its rows each replica has [R]; None for all.
        primitive: r [R, n], only for components that declare `sees_primitive` (the oracle); None for all others.
        fresh: whether a row was taken in the newest round [R, n]; None where all were. Only of a store's newest.
    """

    labels: Tensor
    labelled: Tensor | None = None
    length: int | None = None
    last: Tensor | None = None
    ended: Tensor | None = None
    terminated: Tensor | None = None
    count: Tensor | None = None
    primitive: Tensor | None = None
    fresh: Tensor | None = None

    @classmethod
    def of_grid(cls, states: Tensor, actions: Tensor, next_states: Tensor, labels: Tensor) -> Windows:
        """Windows of equal lengths: steps [R, K, T, ...] and labels [R, K]; memory is shared where it can be.

        Raises:
            UserError: these do not have the same R, K and T.
        """
        shapes = [list(part.shape[:3]) for part in (states, actions, next_states)]
        if shapes != [[*labels.shape, *shapes[0][2:]]] * 3 or labels.dim() != 2:
            raise UserError(
                f"states, actions and next states begin with {shapes}, and labels have {list(labels.shape)}: they must "
                "be [R, K, T, ...] and [R, K]"
            )
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

        Raises:
            UserError: an episode has not as many actions as states, or there is not a label for each.
        """
        if labels.shape != (wanted := (len(episodes), len(episodes[0]))):
            raise UserError(f"labels have the shape {list(labels.shape)}, and these episodes need {list(wanted)}")
        for replica, own in enumerate(episodes):
            for k, episode in enumerate(own):
                counts = [len(part) for part in episode[:3]]
                if len(set(counts)) > 1 or not counts[0]:
                    raise UserError(
                        f"episode {k} of replica {replica} has {counts[0]} states, {counts[1]} actions and {counts[2]} "
                        "next states: each of its steps has one of each, and there is at least one"
                    )
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
    def known(self) -> int | Tensor:
        """How many windows have a label: one number, or that of each replica [R]."""
        return self.labels.shape[1] if self.labelled is None else self.labelled.sum(1)

    @property
    def begun(self) -> int | Tensor:
        """How many episodes began in these windows: one number, or that of each replica [R]."""
        if self.step is None:
            return self.labels.shape[1]
        first = self.step == 0
        return (first if self.valid is None else first & self.valid).sum(1)

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
        last = torch.zeros(self.states.shape[:2], dtype=torch.bool, device=self.labels.device)
        return last.scatter(1, self.ends.clamp(min=0), self.ends >= 0)

    @property
    def valid(self) -> Tensor | None:
        """Which rows mean something [R, n]; None for all."""
        if self.count is None:
            return None
        return torch.arange(len(self), device=self.count.device) < self.count.unsqueeze(1)

    @property
    def once(self) -> Tensor:
        """What a row counts [R, n] float64: 1, and 0 for one that means nothing."""
        valid = self.valid
        if valid is None:
            return torch.ones(self.states.shape[:2], dtype=torch.float64, device=self.states.device)
        return valid.to(torch.float64)

    def grid(self, values: Tensor) -> Tensor:
        """What rows have [R, n, ...], as [R, K, T, ...] in the same memory; only where all windows have T steps."""
        assert self.length is not None, "windows of different lengths have no grid"
        replicas, rows, *rest = values.shape
        return values.view(replicas, rows // self.length, self.length, *rest)

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

"""Labelled trajectories in continuous problems: rows of steps, of all replicas together, in the order they came in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from credit.core.cells import Steps
from credit.core.state import Stateful
from credit.core.tensors import grown
from credit.core.types import Replicas


@dataclass(frozen=True)
class ContinuousProblem(Replicas):
    """What a learner may know before its first step.

    Attributes:
        observations: numbers in a state. actions: numbers in an action, each in [−1, 1].
        window: H, most steps of a trajectory. seeds: one a replica. device: where tensors live.
    """

    observations: int
    actions: int
    window: int
    seeds: tuple[int, ...]
    device: torch.device
    episodic: bool = True


@dataclass(frozen=True)
class Moves(Steps):
    """Steps in rows: states [N, O], actions [N, A], next_states [N, O], float32.

    Attributes:
        replica: of each row [N], int64.
    """

    replica: Tensor

    def __len__(self) -> int:
        """N."""
        return len(self.states)


@dataclass(frozen=True)
class Trajectories(Moves):
    """Labelled trajectories of R replicas, K each: their steps in N rows, a trajectory's one behind the other.

    Attributes:
        number: which of its replica's trajectories a row belongs to [N], 0 … K − 1.
        final: whether a row is the last of its trajectory [N]. terminated: whether nothing lies behind it [N].
        labels: Y [R, K], all that a learner is told about a trajectory.
        primitive: r [N], only for components that declare `sees_primitive` (the oracle); None for all others.
    """

    number: Tensor
    final: Tensor
    terminated: Tensor
    labels: Tensor
    primitive: Tensor | None = None

    @property
    def lengths(self) -> Tensor:
        """L [R, K], steps."""
        return self.sums(torch.ones_like(self.number)).to(self.labels.dtype)

    def to_steps(self, values: Tensor) -> Tensor:
        """What a trajectory has [R, K], for each of its steps [N]."""
        return values[self.replica, self.number]

    def sums(self, values: Tensor) -> Tensor:
        """Sums [R, K, ...] over the steps of each trajectory, of values [N, ...]."""
        replicas, count = self.labels.shape
        total = values.new_zeros(replicas * count, *values.shape[1:])
        return total.index_add_(0, self.replica * count + self.number, values).view(replicas, count, *values.shape[1:])


class TrajectoryDataset(Stateful):
    """Labelled trajectories of R replicas; `new` are those of the last append, `windows` all of them.

    Rows stay where they are: those of an append follow those of the appends before.
    """

    COLUMNS = ("states", "actions", "next_states", "replica", "number", "final", "terminated")

    def __init__(self, problem: ContinuousProblem) -> None:
        self._blocks: dict[str, Tensor] = {}
        self._labels = problem.zeros(0)
        self._rows = 0
        self.new: Trajectories

    def __len__(self) -> int:
        """K."""
        return self._labels.shape[1]

    def append(self, trajectories: Trajectories) -> None:
        """Add trajectories; they are `new` until the next append.

        Raises:
            ValueError: these show their primitive reward, and those before do not, or the other way round.
        """
        columns = {name: getattr(trajectories, name) for name in self.COLUMNS}
        if trajectories.primitive is not None:
            columns["primitive"] = trajectories.primitive
        if self._blocks and columns.keys() != self._blocks.keys():
            raise ValueError("a dataset holds the primitive rewards of all trajectories, or of none")
        start, self._rows = self._rows, self._rows + len(trajectories)
        columns["number"] = columns["number"] + len(self)
        for name, values in columns.items():
            block = self._blocks.get(name, values.new_empty(0, *values.shape[1:]))
            if self._rows > len(block):
                block = grown(block.unsqueeze(0), self._rows)[0]
            block[start : self._rows] = values
            self._blocks[name] = block
        self._labels = torch.cat([self._labels, trajectories.labels], dim=1)
        self.new = trajectories

    def state_dict(self) -> dict[str, Any]:
        """All trajectories, without the room for more."""
        rows = {name: block[: self._rows].cpu().clone() for name, block in self._blocks.items()}
        return {"rows": rows, "labels": self._labels.cpu()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Hold these trajectories and no others."""
        self._blocks, self._labels = dict(state["rows"]), state["labels"]
        self._rows = len(next(iter(self._blocks.values()), ()))

    @property
    def windows(self) -> Trajectories:
        """All trajectories, as views."""
        columns = {name: block[: self._rows] for name, block in self._blocks.items()}
        return Trajectories(**columns, labels=self._labels)

"""What a learner remembers: TorchRL's replay buffer, from which every replica draws steps of its own."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer, Storage
from torchrl.data.replay_buffers.samplers import RandomSampler

from credit.core.state import Stateful
from credit.core.streams import Stream
from credit.core.types import Problem

logging.getLogger("torchrl").setLevel(logging.WARNING)  # it announces every buffer that it makes


class StreamSampler(RandomSampler):
    """Uniform with replacement, each replica from a stream of its own: an item is a step of a window.

    Args:
        problem: gives the seeds and T. batch: steps a replica and draw.
    """

    def __init__(self, problem: Problem, batch: int) -> None:
        super().__init__()
        self.stream = Stream(problem, "replay", "uniform", batch)
        self._window = problem.window
        self._replicas = torch.arange(problem.replicas, device=problem.device).unsqueeze(1)

    def sample(self, storage: Storage, batch_size: int) -> tuple[tuple[Tensor, ...], dict[str, Any]]:
        """Indices (window, replica, step) [R, batch_size·B] into a storage of windows."""
        uniform = torch.cat([self.stream.next() for _ in range(batch_size)], dim=1)
        item = (uniform * (len(storage) * self._window)).to(torch.int64)
        return (item // self._window, self._replicas, item % self._window), {}


class Replay(Stateful):
    """The newest windows of R replicas, with a pseudo-reward for every step that may change later.

    Args:
        problem: sizes. capacity: windows that are kept. batch: steps a sample, B.
        discount: γ of the return.
    """

    def __init__(self, problem: Problem, capacity: int, batch: int, discount: float) -> None:
        self._discount = discount
        self._capacity = capacity
        self._batch = batch
        storage = LazyTensorStorage(capacity, device=problem.device)
        self._sampler = StreamSampler(problem, batch)
        self.buffer = ReplayBuffer(storage=storage, sampler=self._sampler)

    def extend(self, rewards: Tensor, **steps: Tensor) -> None:
        """Add windows with pseudo-rewards [R, K, T] and whatever else is to be known of their steps, [R, K, T]."""
        columns = {name: part[:, -self._capacity :].transpose(0, 1) for name, part in steps.items()}
        columns |= self._credit(rewards[:, -self._capacity :])
        self.buffer.extend(TensorDict(columns, batch_size=columns["reward"].shape))

    def relabel(self, rewards: Tensor) -> None:
        """Replace the rewards of all that is stored by those of all windows so far [R, K, T], oldest first."""
        kept = len(self.buffer)
        # a full buffer starts over at its first row
        newest = rewards[:, -kept:].roll(self.buffer.write_count % kept, dims=1)
        stored = self.buffer[:]
        for name, column in self._credit(newest).items():
            stored.set_(name, column)  # in place: of a part-full buffer, an assignment would change a copy

    def state_dict(self) -> dict[str, Any]:
        """All that is stored, how many windows ever were, and the sampler's stream."""
        rows = {name: column.cpu().clone() for name, column in self.buffer[:].items()} if len(self.buffer) else {}
        return {"rows": rows, "written": self.buffer.write_count, "stream": self._sampler.stream.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Become the memory that gave this state."""
        self.buffer.empty()
        self._sampler.stream.load_state_dict(state["stream"])
        if rows := state["rows"]:
            stored = TensorDict(rows, batch_size=rows["reward"].shape)
            self.buffer.extend(stored)
            if len(stored) == self._capacity and (over := state["written"] % self._capacity):
                self.buffer.extend(stored[:over])  # the next window goes behind these

    def batches(self, count: int) -> Iterator[dict[str, Tensor]]:
        """Name → what is known of B steps of every replica [R, B], `reward` and `outcome` (the return) among them.

        All batches are drawn at once: a call of the buffer costs more than what it returns.
        """
        columns = self.buffer.sample(count).to_dict()
        for parts in zip(*(column.split(self._batch, dim=1) for column in columns.values()), strict=True):
            yield dict(zip(columns, parts, strict=True))

    def _credit(self, rewards: Tensor) -> dict[str, Tensor]:
        by_row = rewards.transpose(0, 1)
        return {"reward": by_row, "outcome": returns(by_row, self._discount)}


def returns(rewards: Tensor, discount: float) -> Tensor:
    """G_t = r_t + γ·G_{t+1}, the return [..., T] from a step to the end of its window, of rewards [..., T]."""
    total, found = torch.zeros_like(rewards[..., 0]), list[Tensor]()
    for reward in reversed(rewards.unbind(-1)):
        total = reward + discount * total
        found.insert(0, total)
    return torch.stack(found, dim=-1)

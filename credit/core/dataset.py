"""All labelled windows so far, in one growing block of memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from credit.core.state import Stateful
from credit.core.tensors import grown
from credit.core.types import Problem, Windows


class Dataset(Stateful):
    """Windows and labels of R replicas; `new` are those of the last append, `windows` all of them.

    Args:
        problem: gives R, T and the device.
        capacity: windows to reserve room for; it grows when that is not enough.
    """

    def __init__(self, problem: Problem, capacity: int) -> None:
        shape = (problem.replicas, max(capacity, 1), problem.window)
        self._steps = [torch.zeros(shape, dtype=torch.int64, device=problem.device) for _ in range(3)]
        self._labels = problem.zeros(shape[1])
        self._primitive: Tensor | None = None
        self._count = 0
        self.new: Windows

    def __len__(self) -> int:
        return self._count

    def append(self, windows: Windows) -> None:
        """Add windows [R, K, T]; they are `new` until the next append."""
        start, stop = self._count, self._count + windows.labels.shape[1]
        if stop > self._labels.shape[1]:
            self._steps = [grown(block, stop) for block in self._steps]
            self._labels = grown(self._labels, stop)
            self._primitive = None if self._primitive is None else grown(self._primitive, stop)
        for block, values in zip(self._steps, (windows.states, windows.actions, windows.next_states), strict=True):
            block[:, start:stop] = values
        self._labels[:, start:stop] = windows.labels
        if windows.primitive is not None:
            if self._primitive is None:
                self._primitive = torch.zeros_like(self._steps[0], dtype=windows.primitive.dtype)
            self._primitive[:, start:stop] = windows.primitive
        self._count = stop
        self.new = windows

    def state_dict(self) -> dict[str, Any]:
        """All windows."""
        windows = self.windows
        parts = (windows.states, windows.actions, windows.next_states, windows.labels, windows.primitive)
        return {"windows": [None if part is None else part.cpu().clone() for part in parts]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Hold these windows and no others."""
        self._count = 0
        self.append(Windows(*state["windows"]))

    @property
    def windows(self) -> Windows:
        """All windows [R, K, T], as views."""
        states, actions, next_states = (block[:, : self._count] for block in self._steps)
        primitive = None if self._primitive is None else self._primitive[:, : self._count]
        return Windows(states, actions, next_states, self._labels[:, : self._count], primitive)

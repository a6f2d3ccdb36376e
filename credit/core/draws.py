"""Random numbers of R replicas for networks: float32 blocks, each replica from its own generator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.state import Stateful
from credit.core.streams import generators


class Draws(Stateful):
    """Numbers that depend on (seed, purpose) alone; how many are drawn at once makes no difference.

    Args:
        seeds: one a replica. purpose: what the numbers are for. device: where they go.
    """

    keeps: ClassVar = ("_generators",)
    acts: ClassVar = ()

    def __init__(self, seeds: Sequence[int], purpose: str, device: torch.device) -> None:
        self._generators = generators(seeds, purpose)
        self._device = device

    def normal(self, *shape: int, axis: int = 0) -> Tensor:
        """Standard normal numbers of a shape for every replica, put side by side along `axis`."""
        drawn = [g.standard_normal(shape, dtype=np.float32) for g in self._generators]
        return torch.from_numpy(np.stack(drawn, axis)).to(self._device)

    def uniform(self, *shape: int, axis: int = 0) -> Tensor:
        """Uniform numbers on [0, 1), float64."""
        drawn = [g.random(shape) for g in self._generators]
        return torch.from_numpy(np.stack(drawn, axis)).to(self._device)

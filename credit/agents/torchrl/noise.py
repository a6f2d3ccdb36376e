"""What exploration draws: numbers that depend on the seed, the copy, its episode and the step alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from credit.core.problem import Replicas
from credit.core.state import Stateful
from credit.core.streams import reset_seed

NoiseKind = Literal["uniform", "normal"]
PART = 64  # steps that are drawn at once


class Noise(Stateful):
    """Random numbers for every step of every copy.

    An episode begins where its step is 0. What a copy draws is a function of (seed, purpose, copy, episode, step), so
    that neither how long other replicas' episodes last, nor where a run was interrupted, makes a difference.

    Args:
        problem: gives the seeds and the device. purpose: what the numbers are for.
        kind: uniform on [0, 1), or standard normal. width: numbers a step.
    """

    keeps: ClassVar = ("_episodes",)
    acts: ClassVar = ()

    def __init__(self, problem: Replicas, purpose: str, kind: NoiseKind, width: int) -> None:
        self._seeds, self._device = problem.seeds, problem.device
        self._purpose, self._kind, self._width = purpose, kind, width
        self._episodes: dict[int, Tensor] = {}  # K → episodes that each copy has begun [R, K]
        self._parts: dict[int, tuple[Tensor, Tensor]] = {}  # K → which part is at hand [R, K], and it [R, K, PART, w]

    def __call__(self, step: Tensor) -> Tensor:
        """The numbers [R, K, width] float32 of K copies at these steps of their episodes [R, K]."""
        step = step.cpu()
        copies = step.shape[1]
        if copies not in self._episodes:
            self._episodes[copies] = torch.zeros_like(step)
        if copies not in self._parts:
            room = torch.zeros(*step.shape, PART, self._width)
            self._parts[copies] = torch.full_like(step, -1), room
        begins, part = step == 0, step // PART
        self._episodes[copies] += begins
        held, numbers = self._parts[copies]
        stale = begins | (held != part)
        if stale.any():
            for replica, copy in stale.nonzero().tolist():
                numbers[replica, copy] = self._drawn(replica, copy, copies, int(part[replica, copy]))
            held.copy_(part)
        place = (step % PART).view(*step.shape, 1, 1).expand(-1, -1, 1, self._width)
        return numbers.gather(2, place).squeeze(2).to(self._device)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there; the numbers of open episodes are drawn again."""
        super().load_state_dict(state)
        self._parts = {}

    def _drawn(self, replica: int, copy: int, copies: int, part: int) -> Tensor:
        episode = int(self._episodes[copies][replica, copy])
        purpose = f"{self._purpose}, {copies} at once, part {part}"
        generator = np.random.default_rng(reset_seed(self._seeds[replica], purpose, copy, episode))
        shape = (PART, self._width)
        drawn = generator.random(shape) if self._kind == "uniform" else generator.standard_normal(shape)
        return torch.from_numpy(drawn).float()

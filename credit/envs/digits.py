"""Values of finite spaces as numbers, and back."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Discrete, MultiBinary, MultiDiscrete, Space
from torch import Tensor


@dataclass(frozen=True)
class Digits:
    """The values of `Discrete`, `MultiDiscrete` and `MultiBinary` as one number, first digit first.

    Attributes:
        base: how many values each digit has [d]. start: the least value of each. shape: of a value; () for a number.
    """

    base: Tensor
    start: Tensor
    shape: tuple[int, ...]

    @classmethod
    def of(cls, space: Space[Any]) -> Digits | None:
        """Those of a space, None where it is not finite."""
        if isinstance(space, Discrete):
            return cls(torch.tensor([int(space.n)]), torch.tensor([int(space.start)]), ())
        if isinstance(space, MultiDiscrete):
            base = torch.from_numpy(np.asarray(space.nvec, dtype=np.int64).reshape(-1))
            start = torch.from_numpy(np.asarray(space.start, dtype=np.int64).reshape(-1))
            return cls(base, start, tuple(space.nvec.shape))
        if isinstance(space, MultiBinary):
            base = torch.full((prod(space.shape),), 2)
            return cls(base, torch.zeros_like(base), tuple(space.shape))
        return None

    @property
    def count(self) -> int:
        """How many values there are."""
        return prod(self.base.tolist())

    @property
    def place(self) -> Tensor:
        """What one of each digit is worth [d]."""
        return torch.tensor([prod(self.base[i + 1 :].tolist()) for i in range(len(self.base))])

    def flat(self, values: Any) -> Tensor:
        """The digits [..., d] of values [..., *shape], each from 0 on."""
        numbers = torch.as_tensor(values).long()
        lead = numbers.dim() - len(self.shape)
        return numbers.reshape(*numbers.shape[:lead], -1) - self.start.to(numbers.device)

    def number(self, values: Any) -> Tensor:
        """The number [...] of values [..., *shape]."""
        digits = self.flat(values)
        return (digits * self.place.to(digits.device)).sum(-1)

    def values(self, numbers: Tensor) -> Tensor:
        """The values [..., *shape] of numbers [...]."""
        place, base, start = (part.to(numbers.device) for part in (self.place, self.base, self.start))
        digits = numbers.unsqueeze(-1) // place % base + start
        return digits.reshape(*numbers.shape, *self.shape)

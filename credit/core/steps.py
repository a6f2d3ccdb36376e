"""What was done and what it led to."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Steps:
    """Steps that were taken; or some to look at, the same for all replicas, without the leading dimension.

    Attributes:
        states: [R, n] int64, or [R, n, O] float32. actions: [R, n] int64, or [R, n, A] float32. next_states: as states.
        step: in the episode, counted from 0 [R, n] int64; where it is None there is `times`.
    """

    states: Tensor
    actions: Tensor
    next_states: Tensor
    step: Tensor | None = None

    def __len__(self) -> int:
        """n."""
        return self.states.shape[1]

    @property
    def times(self) -> Tensor:
        """The step in the episode, counted from 0 [R, n].

        Raises:
            ValueError: that is not known.
        """
        if self.step is None:
            raise ValueError("steps do not say where in the episode they are, and something looks at it: give `step`")
        return self.step

    def pairs(self, actions: int) -> Tensor:
        """Index s·A + a of every step [R, n]."""
        return torch.add(self.actions, self.states, alpha=actions)

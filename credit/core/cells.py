"""What a pseudo-reward is a table over: (s, a) as in the paper, or also s' and the step in the window."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import prod
from typing import Literal

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.steps import Steps

Axis = Literal["step", "state", "action", "next_state"]
ORDER: tuple[Axis, ...] = ("step", "state", "action", "next_state")
PAIRS: tuple[Axis, ...] = ("state", "action")
COLUMNS: dict[Axis, str] = {"step": "times", "state": "states", "action": "actions", "next_state": "next_states"}
LARGEST = 1_000_000  # cells


@dataclass(frozen=True)
class Cells:
    """The cells of a table over some axes, in row-major order: with (state, action), cell n = s·A + a.

    Args:
        axes: what the table looks at, a selection of `ORDER` in its order.
        sizes: how many values each axis has.
    """

    axes: tuple[Axis, ...]
    sizes: tuple[int, ...]

    @classmethod
    def over(cls, axes: Collection[Axis], window: int, states: int, actions: int) -> Cells:
        """The cells over all axes that somebody looks at.

        Raises:
            UserError: s' beside s or a, or too many cells.
        """
        sizes: dict[Axis, int] = {"step": window, "state": states, "action": actions, "next_state": states}
        chosen = tuple(axis for axis in ORDER if axis in axes)
        cells = cls(chosen, tuple(sizes[axis] for axis in chosen))
        what = f"reward models look at {', '.join(chosen)}"
        if "next_state" in axes and {"state", "action"} & set(axes):
            raise UserError(
                f"{what}: a planner needs a pseudo-reward of (s, a) or of s', each with or without the step; "
                "choose feature maps and a reference of one kind (looks_at, patient)"
            )
        if cells.count > LARGEST:
            raise UserError(f"{what}: {cells.count} cells, at most {LARGEST} are kept; let them look at less")
        return cells

    @property
    def count(self) -> int:
        """N."""
        return prod(self.sizes)

    @property
    def arrival(self) -> bool:
        """Whether the pseudo-reward is one of s'."""
        return "next_state" in self.axes

    def index(self, steps: Steps) -> Tensor:
        """The cell of every step, same shape."""
        cell: Tensor | None = None
        for axis, size in zip(self.axes, self.sizes, strict=True):
            column: Tensor = getattr(steps, COLUMNS[axis])
            cell = column if cell is None else torch.add(column, cell, alpha=size)
        return torch.zeros_like(steps.states) if cell is None else cell

    def steps(self, device: torch.device) -> Steps:
        """One step for every cell; what the table does not look at is 0."""
        rest = torch.arange(self.count, device=device)
        values = {axis: torch.zeros_like(rest) for axis in ORDER}
        for axis, size in zip(reversed(self.axes), reversed(self.sizes), strict=True):
            values[axis] = rest % size
            rest = rest // size
        return Steps(values["state"], values["action"], values["next_state"], values["step"])

    def known(self, of_pair: Tensor, of_arrival: Tensor | None = None) -> Tensor:
        """A known reward as a table [N], NaN where such a table cannot say it.

        Args:
            of_pair: r(s, a) [S, A]. of_arrival: r(s') [S], where it is one of s'.
        """
        reward = of_arrival if self.arrival else of_pair if set(PAIRS) <= set(self.axes) else None
        table = torch.full(self.sizes, torch.nan, dtype=of_pair.dtype, device=of_pair.device)
        return (table if reward is None else reward.expand(self.sizes)).flatten()

    def at(self, values: Tensor, step: int, pairs: tuple[int, int]) -> tuple[Tensor, Tensor]:
        """Values [R, N] at one step of the window, as what a planner needs: r(s, a) [R, S, A] and r(s') [R, S'].

        Where the table is over (s, a) the second part is 0, where it is over s' the first.

        Args:
            values: [R, N]. step: t. pairs: S, A.
        """
        table = values.reshape(-1, *self.sizes)
        if "step" in self.axes:
            table = table[:, step]
        if self.arrival:
            return table.new_zeros(1, 1, 1), table
        for axis, dim in (("state", 1), ("action", 2)):
            if axis not in self.axes:
                table = table.unsqueeze(dim)
        return table.expand(-1, *pairs), table.new_zeros(1, pairs[0])

"""The oracle's reward model: it is shown what nobody else sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor

from credit.cells import PAIRS, Axis, Cells
from credit.interfaces import RewardModel
from credit.types import FLOAT, Estimate, Problem, Windows


class PrimitiveReward(RewardModel):
    """The mean primitive reward seen in every cell, zero where none was seen: the floor for recovery methods.

    Args:
        name: the model's name in metrics, files and figures.
        looks_at: the axes of the table.
    """

    domain: ClassVar = "tabular"
    sees_primitive: ClassVar = True

    def __init__(self, name: str = "primitive", looks_at: Sequence[Axis] = PAIRS) -> None:
        self.name = name
        self.looks_at = looks_at

    def start(self, problem: Problem, draws: int) -> None:
        """Nothing seen yet."""
        self._all, self._draws = problem.cells, draws
        self._cells = Cells.over(self.looks_at, problem.window, problem.states, problem.actions)
        self._total, self._visits = problem.zeros(self._cells.count), problem.zeros(self._cells.count)

    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Add the primitive reward of every step."""
        if windows.primitive is None:
            raise ValueError("the primitive reward was not shown to the oracle")
        cells = self._cells.index(windows).flatten(1)
        self._total.scatter_add_(1, cells, windows.primitive.flatten(1))
        self._visits.scatter_add_(1, cells, torch.ones_like(cells, dtype=FLOAT))

    def refit(self, windows: Windows, weights: Tensor) -> None:
        """Forget, and see these windows."""
        self._total.zero_()
        self._visits.zero_()
        self.observe(windows, weights)

    def estimate(self) -> Estimate:
        """The table, without spread."""
        table = self._cells.spread(self._total / self._visits.clamp(min=1), self._all)
        return Estimate(table, table.unsqueeze(1).expand(-1, self._draws, -1))

"""The oracle's reward model: it is shown what nobody else sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import PAIRS, Axis, Cells
from credit.core.tables import CellModel
from credit.core.types import FLOAT, Estimate, Problem, Windows


class PrimitiveReward(CellModel):
    """The mean primitive reward seen in every cell, zero where none was seen: the floor for recovery methods.

    Args:
        name: the model's name in metrics, files and figures.
        looks_at: the axes of the table.
    """

    domain: ClassVar = "tabular"
    sees_primitive: ClassVar = True
    keeps: ClassVar = ("_total", "_visits")

    def __init__(self, name: str = "primitive", looks_at: Sequence[Axis] = PAIRS) -> None:
        self.name = name
        self.looks_at = looks_at

    def start(self, problem: Problem, draws: int) -> None:
        """Nothing seen yet."""
        self._draws = draws
        self._cells = Cells.over(self.looks_at, problem.window, problem.states, problem.actions)
        self._own = self._cells.index(problem.cells.steps(problem.device))
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

    def looks(self, problem: Problem) -> Tensor:
        """All unvisited cells have 0, unless the table tells less apart than other models do."""
        return self._own if self._cells != problem.cells else torch.zeros_like(self._own)

    def estimate(self, cells: Tensor | None = None) -> Estimate:
        """The table, for some cells [R, n] or for all, without spread."""
        own = self._own.expand(len(self._total), -1) if cells is None else self._own[cells]
        table = (self._total / self._visits.clamp(min=1)).gather(1, own)
        return Estimate(table, table.unsqueeze(1).expand(-1, self._draws, -1))

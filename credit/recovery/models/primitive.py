"""The oracle's reward model: it is shown what nobody else sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.cells import PAIRS, Axis, Cells
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Name
from credit.core.seams import Places, RewardModel, Uncertainty
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.tensors import grown
from credit.core.windows import Windows


class PrimitiveReward(RewardModel):
    """The mean primitive reward seen at every place, zero where none was seen: the floor for recovery methods.

    Where states or actions are vectors, a place is a step, and its mean is the reward itself.

    Args:
        name: the model's name in metrics, files and figures.
        looks_at: the axes of the table, where there is one.
        uncertainty: of the other models; its draws are all the same here.
    """

    sees_primitive: ClassVar = True
    keeps: ClassVar = ("_total", "_visits")

    def __init__(
        self, name: Name = "primitive", looks_at: Sequence[Axis] = PAIRS, uncertainty: Uncertainty | None = None
    ) -> None:
        self.name = name
        self.looks_at = looks_at
        self.uncertainty = uncertainty

    def start(self, problem: Problem, places: Places) -> None:
        """Nothing seen yet."""
        self._places, self._problem = places, problem
        if self.uncertainty is not None:
            self.uncertainty.start(problem)
        self._cells: Cells | None = None
        self._own: Tensor | None = None
        if places.cells is not None:
            self._cells = Cells.over(self.looks_at, problem.horizon, problem.states, problem.actions)
            self._own = self._cells.index(places.cells.steps(problem.device))
        count = 0 if self._cells is None else self._cells.count
        self._total, self._visits = problem.zeros(count), problem.zeros(count)

    def filled(self) -> Mapping[str, int]:
        """As many columns as rows, where places are those."""
        counts = self._places.counts if self._cells is None else None
        return {} if counts is None else dict.fromkeys(("_total", "_visits"), max(counts))

    def observe(self, store: Store) -> None:
        """Add the primitive reward of every step of the newest windows.

        Raises:
            ValueError: it was not shown.
        """
        windows = store.new
        if windows.primitive is None:
            raise ValueError("the primitive reward was not shown to the oracle")
        place = self._index(windows)
        if not place.numel():
            return
        if (last := int(place.max())) >= self._total.shape[1]:
            self._total, self._visits = grown(self._total, last + 1), grown(self._visits, last + 1)
        valid = windows.valid
        once = torch.ones_like(place, dtype=FLOAT) if valid is None else valid.to(FLOAT)
        self._total.scatter_add_(1, place, windows.primitive * once)
        self._visits.scatter_add_(1, place, once)

    def _index(self, windows: Windows) -> Tensor:
        return self._places.index(windows) if self._cells is None else self._cells.index(windows)

    def looks(self) -> Tensor | None:
        """All unvisited cells have 0, unless the table tells less apart than other models do."""
        assert self._own is not None
        return self._own if self._cells != self._places.cells else torch.zeros_like(self._own)

    def estimate(self, at: Tensor | None = None) -> Estimate:
        """The table, for some places [R, n] or for all, without spread."""
        table = self._total / self._visits.clamp(min=1)
        if self._own is not None:
            table = table.gather(1, self._own.expand(len(table), -1) if at is None else self._own[at])
        else:
            counts = self._places.counts
            table = table[:, : max(counts) if counts else None] if at is None else table.gather(1, at)
        draws = getattr(self.uncertainty, "draws", 0)
        same = table.unsqueeze(1).expand(-1, draws, -1) if draws else None
        return Estimate(table, torch.zeros_like(table), same)

    def believe(self, steps: Steps) -> Estimate:
        """The table for other steps [n]; NaN where there is none."""
        if self._cells is not None:
            own = self._cells.index(steps).expand(self._problem.replicas, -1)
            table = (self._total / self._visits.clamp(min=1)).gather(1, own)
        else:
            table = self._problem.zeros(len(steps.states)) + torch.nan
        return Estimate(table, torch.zeros_like(table), None)

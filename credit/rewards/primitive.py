"""The oracle's reward model: it is shown what nobody else sees."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor

from credit.interfaces import RewardModel
from credit.types import Estimate, Problem, Windows


class PrimitiveReward(RewardModel):
    """Remembers the primitive reward of every pair it has visited, zero elsewhere: the floor for recovery methods.

    Args:
        name: the model's name in metrics, files and figures.
    """

    domain: ClassVar = "tabular"
    sees_primitive: ClassVar = True

    def __init__(self, name: str = "primitive") -> None:
        self.name = name

    def start(self, problem: Problem, draws: int) -> None:
        """Nothing seen yet."""
        self._actions, self._draws = problem.actions, draws
        self._table = problem.zeros(problem.pairs)

    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Write down r(s, a) of every step."""
        if windows.primitive is None:
            raise ValueError("the primitive reward was not shown to the oracle")
        self._table.scatter_(1, windows.pairs(self._actions).flatten(1), windows.primitive.flatten(1))

    def refit(self, windows: Windows, weights: Tensor) -> None:
        """As `observe`: what was seen once is known."""
        self.observe(windows, weights)

    def estimate(self) -> Estimate:
        """The table, without spread."""
        table = self._table.clone()
        return Estimate(table, table.unsqueeze(1).expand(-1, self._draws, -1))

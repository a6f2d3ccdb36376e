"""DeepSea (Osband et al. 2019): a treasure behind N right steps, of which every one costs something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from credit.core.ranges import NonNegativeInt, PositiveInt
from credit.envs.exact.outcomes import Outcome, OutcomeEnvironment


class DeepSea(OutcomeEnvironment):
    """DeepSea: a diver sinks one row a step in a grid of N × N, and goes a column to the left or to the right.

    Going right costs `cost`/N, and gives 1 in the last column; only N steps to the right reach it, so that the best
    return is 1 − cost and that of almost all other policies is below 0 (Osband et al. 2019,
    "Behaviour suite for reinforcement learning", deep_sea). In a windy sea a move to the right fails with probability
    1/N, and costs and gives the same (deep_sea_stochastic); rewards in the first and last cell of the last row have
    N(0, 1) added. State N·row + column; behind the last row lies state N².

    Args:
        horizon: N, rows, columns, and steps of an episode.
        cost: of N steps to the right.
        windy: whether moves fail and rewards are noisy.
        mapping: seed of which action is right in each cell, which the definition draws (the numbers are not those of
            bsuite for that seed); None: action 1 is, everywhere.
    """

    def __init__(
        self,
        horizon: PositiveInt = 10,
        cost: float = 0.01,
        windy: bool = False,
        mapping: NonNegativeInt | None = None,
    ) -> None:
        self.horizon = horizon
        self.sizes = (horizon**2 + 1, 2)
        self.cost, self.windy = cost, windy
        cells = (horizon, horizon)
        self.right = np.ones(cells, int) if mapping is None else np.random.default_rng(mapping).integers(2, size=cells)

    def first(self) -> dict[int, float]:
        """The upper left cell."""
        return {0: 1.0}

    def outcomes(self, state: int, action: int) -> Sequence[Outcome]:
        """One row down; nothing below the last one."""
        size = self.horizon
        row, column = divmod(state, size)
        if row == size:
            return []
        stay, left, right = (self._below(row, column + move) for move in (0, -1, 1))
        if action != self.right[row, column]:
            return [(1.0, left, 0.0)]
        reward = float(column == size - 1) - self.cost / size
        fails = 1 / size if self.windy else 0.0
        return [(1 - fails, right, reward), (fails, stay, reward)]

    def deviation(self, state: int, action: int) -> float:
        """1 in the first and last cell of the last row of a windy sea."""
        row, column = divmod(state, self.horizon)
        return float(self.windy and row == self.horizon - 1 and column in (0, row))

    def _below(self, row: int, column: int) -> int:
        size = self.horizon
        return size**2 if row + 1 == size else (row + 1) * size + min(max(column, 0), size - 1)

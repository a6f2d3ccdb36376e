"""A replay from which replicas may draw different numbers of batches."""

from __future__ import annotations

from credit.core.draws import Draws
from credit.core.problem import Problem
from credit.data.replay import Replay


class Memory(Replay):
    """A replay whose random numbers begin anew with every round, by (seed, purpose, round).

    All replicas draw as often as the one that needs the most, and those that need less leave the rest; what they draw
    in the next round is the same as if they were alone.

    Args:
        problem: as for `Replay`. n_step: n. discount: γ. capacity: windows that are remembered.
    """

    def __init__(self, problem: Problem, n_step: int, discount: float, capacity: int | None) -> None:
        super().__init__(problem, n_step, discount, capacity=capacity)

    def begin(self, number: int) -> None:
        """Draw the numbers of this round from now on."""
        self._draws = Draws(self._problem.seeds, f"torchrl/replay, round {number}", self._problem.device)

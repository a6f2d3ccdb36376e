"""Planning for the average reward, or a discounted one, in a task that goes on for ever."""

from __future__ import annotations

from typing import Annotated, ClassVar

import torch
from annotated_types import Interval
from torch import Tensor

from credit.agents.planner import Planner
from credit.core.cells import Cells
from credit.core.checks import require_finite
from credit.core.problem import Problem
from credit.core.seams import TransitionTable
from credit.planning.solve import NEARLY_ONE, best_policy


class ValueIteration(Planner):
    """Dynamic programming on (P̂, r_plan) after every window, solved exactly by warm-started policy iteration.

    Args:
        transition: the transition model P̂.
        discount: γ; 1 plans for the average reward. γ ≤ .98 plans the advertiser's trap even on the true model.
    """

    setting: ClassVar = "continuing"
    needs: ClassVar = {"transition": TransitionTable}

    def __init__(self, transition: TransitionTable, discount: Annotated[float, Interval(gt=0, le=1)] = 1.0) -> None:
        super().__init__(transition)
        self._model = transition
        self.discount = discount

    def start(self, problem: Problem) -> None:
        """Nothing is known: action 0 everywhere."""
        super().start(problem)
        self._actions = torch.zeros(problem.replicas, problem.states, dtype=torch.int64, device=problem.device)

    def plan(self, cells: Cells, reward: Tensor, anew: bool) -> Tensor:
        """The best actions [R, S], from those of the last plan on."""
        table, arrival = cells.at(reward, 0, (self._problem.states, self._problem.actions))
        if cells.arrival:
            table = self.transition.backup(arrival)
        discount = min(self.discount, NEARLY_ONE)
        probabilities = self._model.probabilities()
        seeds = self._problem.seeds
        require_finite("planning: a probability", probabilities, seeds, f"; look at {type(self._model).__name__}")
        return best_policy(probabilities, table, discount, self._actions)

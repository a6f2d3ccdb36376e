"""Planning with the recovered reward: B.1, lines 15 to 18."""

from __future__ import annotations

from typing import Annotated, ClassVar

import torch
from annotated_types import Interval
from torch import Tensor

from credit.core.cells import Cells
from credit.core.dataset import Dataset
from credit.core.interfaces import CreditAssigner, Optimizer
from credit.core.tables import RewardFunction, TransitionTable
from credit.core.types import Problem
from credit.planning.solve import NEARLY_ONE, policy_iteration


class ValueIteration(Optimizer):
    """Dynamic programming on (P̂, r_plan) after every window, solved exactly by warm-started policy iteration.

    Args:
        transition: the transition model P̂.
        discount: γ; 1 plans for the average reward. γ ≤ .98 plans the advertiser's trap even on the true model.
    """

    domain: ClassVar = "tabular"
    setting: ClassVar = "continuing"
    needs: ClassVar = {"assigner": RewardFunction, "transition": TransitionTable}
    keeps: ClassVar = ("transition", "_policy")

    def __init__(self, transition: TransitionTable, discount: Annotated[float, Interval(gt=0, le=1)] = 1.0) -> None:
        self.transition = transition
        self.discount = discount

    def start(self, problem: Problem) -> None:
        """Nothing is known: action 0 everywhere."""
        self._problem = problem
        self.transition.start(problem)
        self._policy = torch.zeros(problem.replicas, problem.states, dtype=torch.int64, device=problem.device)
        self._assigner: RewardFunction | None = None

    def act(self, states: Tensor, step: int) -> Tensor:
        """π(s)."""
        return self._policy.gather(1, states.unsqueeze(1)).squeeze(1)

    def improve(self, dataset: Dataset, assigner: CreditAssigner) -> None:
        """Count the new transitions and plan with r_plan."""
        assert isinstance(assigner, RewardFunction)
        self.transition.observe(dataset.new)
        self._assigner = assigner
        self._policy = self._plan(assigner.recovery().cells, assigner.recovery().plan)

    def policies(self) -> dict[str, Tensor]:
        """The optimistic policy, and the one that plans with the mixed reward alone."""
        if self._assigner is None:
            return {"behaviour": self._policy}
        recovery = self._assigner.recovery()
        return {"behaviour": self._policy, "greedy": self._plan(recovery.cells, recovery.mixed)}

    def _plan(self, cells: Cells, reward: Tensor) -> Tensor:
        table, arrival = cells.at(reward, 0, (self._problem.states, self._problem.actions))
        if cells.arrival:
            table = self.transition.backup(arrival)
        discount = min(self.discount, NEARLY_ONE)
        return policy_iteration(self.transition.probabilities(), table, discount, self._policy).policy

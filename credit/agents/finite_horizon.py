"""Planning in episodes, with a policy that depends on the step."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.agents.planner import Planner
from credit.core.cells import Cells
from credit.core.checks import require_finite
from credit.core.problem import Problem
from credit.core.streams import Stream
from credit.planning.solve import TIE


class FiniteHorizon(Planner):
    """Finite-horizon value iteration on (P̂, r_plan): Q_t = r_plan + P̂ max Q_{t+1}, for t = T−1 … 0 (A.2).

    Ties go to a random action, drawn anew at every plan: order would prefer no treatment.

    Args:
        transition: the transition model P̂.
    """

    setting: ClassVar = "episodic"
    keeps: ClassVar = (*Planner.keeps, "_stream", "_order")

    def start(self, problem: Problem) -> None:
        """Nothing is known: every action is tied."""
        super().start(problem)
        self._stream = Stream(problem, "ties", "uniform", problem.pairs)
        self._actions = self.plan(problem.cells, problem.zeros(problem.cells.count), anew=True)

    def plan(self, cells: Cells, reward: Tensor, anew: bool) -> Tensor:
        """The best actions [R, T, S]."""
        problem = self._problem
        if anew:
            self._order = 1 + self._stream.next().view(-1, problem.states, problem.actions)
        values = problem.zeros(problem.states)
        policy, goes_on = list[Tensor](), self.goes_on
        for step in reversed(range(problem.horizon)):
            now, arrival = cells.at(reward, step, (problem.states, problem.actions))
            ahead = now + self.transition.backup(arrival + goes_on * values)
            values = ahead.amax(-1)
            tied = ahead >= (values - TIE).unsqueeze(-1)
            policy.insert(0, (tied * self._order).argmax(-1))
        require_finite("planning: a value", values, problem.seeds, "; are rewards and transitions finite?")
        return torch.stack(policy, dim=1)

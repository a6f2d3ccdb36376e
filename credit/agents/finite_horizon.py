"""Planning in episodes: B.1 with a policy that depends on the step."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import Cells
from credit.core.dataset import Dataset
from credit.core.interfaces import CreditAssigner, Optimizer
from credit.core.streams import Stream
from credit.core.tables import RewardFunction, TransitionModel
from credit.core.types import Problem
from credit.planning.solve import TIE


class FiniteHorizon(Optimizer):
    """Finite-horizon value iteration on (P̂, r_plan): Q_t = r_plan + P̂ max Q_{t+1}, for t = T−1 … 0 (A.2).

    Ties go to a random action, drawn anew at every plan: order would prefer no treatment.

    Args:
        transition: the transition model P̂.
    """

    domain: ClassVar = "tabular"
    setting: ClassVar = "episodic"
    needs: ClassVar = {"assigner": RewardFunction}
    keeps: ClassVar = ("transition", "_stream", "_order", "_policy")

    def __init__(self, transition: TransitionModel) -> None:
        self.transition = transition

    def start(self, problem: Problem) -> None:
        """Nothing is known: every action is tied."""
        self._problem = problem
        self.transition.start(problem)
        self._stream = Stream(problem, "ties", "uniform", problem.pairs)
        self._assigner: RewardFunction | None = None
        self._shuffle()
        self._policy = self._plan(problem.cells, problem.zeros(problem.cells.count))

    def act(self, states: Tensor, step: int) -> Tensor:
        """π_t(s)."""
        return self._policy[:, step].gather(1, states.unsqueeze(1)).squeeze(1)

    def improve(self, dataset: Dataset, assigner: CreditAssigner) -> None:
        """Count the new transitions and plan with r_plan."""
        assert isinstance(assigner, RewardFunction)
        self.transition.observe(dataset.new)
        self._assigner = assigner
        self._shuffle()
        recovery = assigner.recovery()
        self._policy = self._plan(recovery.cells, recovery.plan)

    def policies(self) -> dict[str, Tensor]:
        """The optimistic policy [R, T, S], and the one that plans with the mixed reward alone."""
        if self._assigner is None:
            return {"behaviour": self._policy}
        recovery = self._assigner.recovery()
        return {"behaviour": self._policy, "greedy": self._plan(recovery.cells, recovery.mixed)}

    def executed(self) -> Tensor:
        """The optimistic policy [R, T, S]."""
        return self._policy

    def _shuffle(self) -> None:
        self._order = 1 + self._stream.next().view(-1, self._problem.states, self._problem.actions)

    def _plan(self, cells: Cells, reward: Tensor) -> Tensor:
        problem = self._problem
        values = problem.zeros(problem.states)
        policy: list[Tensor] = []
        for step in reversed(range(problem.window)):
            now, arrival = cells.at(reward, step, (problem.states, problem.actions))
            ahead = now + self.transition.backup(arrival + values)
            values = ahead.amax(-1)
            tied = ahead >= (values - TIE).unsqueeze(-1)
            policy.insert(0, (tied * self._order).argmax(-1))
        return torch.stack(policy, dim=1)

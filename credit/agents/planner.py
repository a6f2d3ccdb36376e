"""What planners share: they count transitions, and plan with the table of rewards that an assigner has."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import PAIRS, Cells
from credit.core.checks import require_finite
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.seams import Agent, CreditAssigner, Transition
from credit.core.state import Packed
from credit.core.store import Store
from credit.core.windows import Windows


class Planner(Agent):
    """Dynamic programming on (P̂, r_plan) after every round: B.1, lines 15 to 18. States and actions are numbers.

    An assigner that has no table of rewards gives each step its own; a pair (s, a) is then worth the mean of those of
    its steps, and one that was never seen the mean of all. Behind a state in which episodes end nothing is worth
    anything: its value counts as often as they went on from there.

    Args:
        transition: the transition model P̂.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    keeps: ClassVar[tuple[str, ...]] = ("transition", "_actions", "_greedy", "_total", "_visits", "_arrivals", "_ends")
    acts: ClassVar[tuple[str, ...] | None] = ("_actions",)
    _actions: Tensor  # of the last plan, [R, S] or [R, T, S]

    def __init__(self, transition: Transition) -> None:
        self.transition = transition

    def start(self, problem: Problem) -> None:
        """No transition was seen."""
        self._problem = problem
        self.transition.start(problem)
        self._total, self._visits = problem.zeros(problem.pairs), problem.zeros(problem.pairs)
        self._arrivals, self._ends = problem.zeros(problem.states), problem.zeros(problem.states)  # N(s'), and the last
        self._rewards: tuple[Cells, Tensor, Tensor] | None = None  # of the last plan; None where it was another's
        self._greedy = torch.zeros(0, dtype=torch.int64, device=problem.device)  # as planned when somebody last looked

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """What the plan says."""
        return self._follow(self._actions).act(states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Count the new transitions and plan with r_plan.

        Raises:
            RunError: a reward is not finite.
        """
        self.transition.observe(store.new)
        self._count_ends(store.new)
        self._rewards = assigner.table() or self._averaged(store, assigner)
        cells, reward, _ = self._rewards
        require_finite("planning: a reward", reward, self._problem.seeds, "; are the labels finite?")
        self._actions = self.plan(cells, reward, anew=True)

    def policies(self) -> dict[str, Policy]:
        """The optimistic policy, and the one that plans with the mixed reward alone."""
        self._look_ahead()
        greedy = self._greedy if self._greedy.numel() else self._actions
        return {"behaviour": self._follow(self._actions), "greedy": self._follow(greedy)}

    def state_dict(self) -> dict[str, Packed]:
        """With what the greedy policy does: the rewards that it follows from are no part of the state."""
        self._look_ahead()
        return super().state_dict()

    def _look_ahead(self) -> None:
        """Plan with the mixed reward alone, where that was not done since the last plan."""
        if self._rewards is not None:
            cells, _, reward = self._rewards
            self._greedy, self._rewards = self.plan(cells, reward, anew=False), None

    def executed(self) -> Policy:
        """The optimistic policy."""
        return self._follow(self._actions)

    def table(self) -> Tensor | None:
        """The plan, where it is the same in every step."""
        return self._actions if self._actions.dim() == 2 else None

    def _follow(self, actions: Tensor) -> TablePolicy:
        return TablePolicy(actions, self._problem.actions)

    @abstractmethod
    def plan(self, cells: Cells, reward: Tensor, anew: bool) -> Tensor:
        """The best actions [R, S] or [R, T, S] for rewards [R, N] of cells; `anew`: after new windows."""

    def _count_ends(self, windows: Windows) -> None:
        if windows.terminated is not None:
            self._arrivals.scatter_add_(1, windows.next_states, windows.once)
            self._ends.scatter_add_(1, windows.next_states, windows.once * windows.terminated)

    @property
    def goes_on(self) -> Tensor:
        """How often an episode went on after it had come to a state [R, S]; 1 where none has."""
        return 1 - self._ends / self._arrivals.clamp(min=1)

    def _averaged(self, store: Store, assigner: CreditAssigner) -> tuple[Cells, Tensor, Tensor]:
        """Cells (s, a), and the mean reward of each [R, N], twice: there is no optimism."""
        problem, windows = self._problem, store.new
        if assigner.learns:  # what old steps were worth has changed
            windows = store.windows
            self._total.zero_()
            self._visits.zero_()
        rewards, pairs = assigner.rewards(windows), windows.pairs(problem.actions)
        once = windows.once
        self._total.scatter_add_(1, pairs, rewards * once)
        self._visits.scatter_add_(1, pairs, once)
        table = mean_rewards(self._total, self._visits)
        return Cells.over(PAIRS, problem.horizon, problem.states, problem.actions), table, table


def mean_rewards(total: Tensor, visits: Tensor) -> Tensor:
    """The mean reward [R, N] of cells with so many visits and this sum; the mean of all where there was none."""
    overall = total.sum(1, keepdim=True) / visits.sum(1, keepdim=True).clamp(min=1)
    return torch.where(visits > 0, total / visits.clamp(min=1), overall)

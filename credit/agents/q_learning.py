"""Tabular Q-learning on relabelled steps: the model-free baseline of A.1."""

from __future__ import annotations

from typing import Annotated, ClassVar

import torch
from annotated_types import Interval
from torch import Tensor

from credit.agents.exploring import EpsilonGreedy, explored
from credit.core.checks import require_finite
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.ranges import Probability
from credit.core.seams import Agent, CreditAssigner
from credit.core.store import Store
from credit.core.streams import each_step
from credit.core.windows import Windows
from credit.planning.solve import first_best


class QLearning(Agent):
    """Q(s, a) += lr·(r + γ max Q(s', ·) − Q(s, a)), ε-greedy, updated step by step once the window's label is known.

    States and actions are numbers. There is no time index. In a task that goes on, the last step of a window bootstraps
    into the next; in episodes, nothing lies behind a terminated step, nor behind step T.

    Args:
        learning_rate: lr.
        discount: γ.
        epsilon: exploration in the first window.
        epsilon_decay: factor on ε from one window to the next.
        epsilon_floor: least ε.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    keeps: ClassVar = ("_q", "_stream", "_windows")
    acts: ClassVar = ("_q",)

    def __init__(
        self,
        learning_rate: Annotated[float, Interval(gt=0, le=1)] = 0.05,
        discount: Annotated[float, Interval(ge=0, lt=1)] = 0.99,
        epsilon: Probability = 1.0,
        epsilon_decay: Probability = 0.998,
        epsilon_floor: Probability = 0.02,
    ) -> None:
        self.learning_rate = learning_rate
        self.discount = discount
        self.epsilon = epsilon
        self.epsilon_decay = epsilon_decay
        self.epsilon_floor = epsilon_floor

    def start(self, problem: Problem) -> None:
        """Q = 0."""
        self._problem = problem
        self._q = problem.zeros(problem.states, problem.actions)
        self._flat = self._q.view(problem.replicas, -1)
        self._stream = each_step(problem, "epsilon-greedy", "uniform", 2)
        self._windows: int | Tensor = 0  # with a label

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """A uniform action with probability ε, else the first best."""
        values = self._q.gather(1, states.unsqueeze(-1).expand(-1, -1, self._problem.actions))
        return explored(first_best(values), self._exploration(), self._problem.actions, self._stream.rows(step))

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """One sweep over the newest windows, in the order in which they happened.

        Raises:
            RunError: a value is not finite.
        """
        windows = store.new
        rewards = assigner.rewards(windows)
        rate, discount = self._rates(windows)
        pairs = windows.pairs(self._problem.actions)
        arrivals = windows.next_states.unsqueeze(-1).expand(-1, -1, self._problem.actions)
        for t in range(pairs.shape[1]):
            pair = pairs[:, t : t + 1]
            ahead = self._q.gather(1, arrivals[:, t : t + 1]).amax(-1)
            now = self._flat.gather(1, pair)
            target = rewards[:, t : t + 1] + _at(discount, t) * ahead
            self._flat.scatter_(1, pair, torch.lerp(now, target, _at(rate, t)))
        require_finite("Q-learning: a value", self._q, self._problem.seeds, "; are the rewards finite?")
        self._windows = self._windows + windows.known

    def _rates(self, windows: Windows) -> tuple[float | Tensor, float | Tensor]:
        """lr, or that of each row [R, n], 0 where it means nothing; and γ, 0 for rows behind which nothing lies."""
        rate = self.learning_rate if windows.valid is None else self.learning_rate * windows.once
        if not self._problem.episodic:
            return rate, self.discount
        over = windows.times == self._problem.horizon - 1
        if windows.terminated is not None:
            over = over | windows.terminated
        return rate, self.discount * (~over).double()

    def policies(self) -> dict[str, Policy]:
        """Greedy in Q; exploration is not counted as an error of the policy."""
        policy = self._greedy()
        return {"behaviour": policy, "greedy": policy}

    def executed(self) -> Policy:
        """ε-greedy."""
        return EpsilonGreedy(self._greedy(), self._exploration(), self._problem.actions, self._stream)

    def _greedy(self) -> Policy:
        return TablePolicy(first_best(self._q), self._problem.actions)

    def _exploration(self) -> float | Tensor:
        """ε, or that of each replica [R, 1] where they saw different numbers of labels."""
        if isinstance(self._windows, Tensor):
            return (self.epsilon * self.epsilon_decay**self._windows).clamp(min=self.epsilon_floor).unsqueeze(1)
        return max(self.epsilon * self.epsilon_decay**self._windows, self.epsilon_floor)


def _at(values: float | Tensor, t: int) -> float | Tensor:
    """Of values of each row [R, n] those of one [R, 1]; one for all as it is."""
    return values[:, t : t + 1] if isinstance(values, Tensor) else values

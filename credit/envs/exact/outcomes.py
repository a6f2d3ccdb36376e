"""Exact episodic MDPs from lists of what a step may lead to: an environment of this kind is a few lines."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import ClassVar

import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.core.knowledge import KnownTransitions
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Transitions
from credit.core.streams import Stream
from credit.core.truth import EpisodicTruth
from credit.envs.exact.base import ExactEnvironment, cumulative, require_distributions, successor
from credit.envs.exact.episodic import expected
from credit.envs.exact.pairs import PairMDP

Outcome = tuple[float, int, float]  # probability, s', r(s, a, s')


@dataclass(frozen=True)
class OutcomeMDP:
    """P and r as lists of outcomes, the deviation of r and the start: the truth, which no learner sees.

    Row n = s·A + a lists W outcomes; entries of probability zero are padding.

    Args:
        probabilities: [S·A, W]. next_states: [S·A, W] int64. rewards: the mean of r(s, a, s') [S·A, W].
        deviation: of the Gaussian noise on r [S·A]. initial: [S].
        final: in which states episodes end [S]; their rows lead back to them and give nothing.

    Raises:
        UserError: a row of P, or the initial distribution, is no distribution.
    """

    probabilities: Tensor
    next_states: Tensor
    rewards: Tensor
    deviation: Tensor
    initial: Tensor
    final: Tensor

    def __post_init__(self) -> None:
        require_distributions(self.probabilities, self.initial)

    @property
    def states(self) -> int:
        """S."""
        return len(self.initial)

    @property
    def actions(self) -> int:
        """A."""
        return len(self.deviation) // self.states

    @property
    def transitions(self) -> KnownTransitions:
        """P alone, without a way back to the rewards."""
        return KnownTransitions(partial(expected, self.pairs.goes_on))

    @cached_property
    def pairs(self) -> PairMDP:
        """What every pair leads to and gives in expectation."""
        possible = self.probabilities > 0
        rows, columns = possible.nonzero()[:, 0].numpy(), self.next_states[possible].numpy()
        shape = (len(possible), self.states)
        goes_on = csr_array((self.probabilities[possible].numpy(), (rows, columns)), shape=shape)
        reward = (self.probabilities * self.rewards).sum(-1).view(self.states, -1)
        return PairMDP(goes_on, reward, self.initial)


class OutcomeEnvironment(ExactEnvironment):
    """Copies of one exact MDP that is given by what each step may lead to.

    A state has to know the time: every episode ends after `horizon` steps, in a state without outcomes.

    Attributes:
        horizon: steps of an episode. sizes: S, A.
    """

    setting: ClassVar = "episodic"
    keeps: ClassVar = (*ExactEnvironment.keeps, "_noise", "_noises")
    horizon: int
    sizes: tuple[int, int]

    @abstractmethod
    def first(self) -> Mapping[int, float]:
        """Where episodes begin: state → probability."""

    @abstractmethod
    def outcomes(self, state: int, action: int) -> Sequence[Outcome]:
        """What a step may lead to: probability, s' and the mean of r(s, a, s') of each; nothing where episodes end."""

    def deviation(self, state: int, action: int) -> float:
        """The standard deviation of the Gaussian noise on r(s, a, ·); none by default."""
        return 0.0

    @cached_property
    def mdp(self) -> OutcomeMDP:
        """P and r, written out once."""
        pairs = list(product(*map(range, self.sizes)))
        listed = [self.outcomes(*pair) for pair in pairs]
        most = max(map(len, listed))
        filled = [row or [(1.0, state, 0.0)] for row, (state, _) in zip(listed, pairs, strict=True)]
        padded = [[*row, *[(0.0, 0, 0.0)] * (most - len(row))] for row in filled]
        probabilities, then, rewards = torch.tensor(padded, dtype=FLOAT).unbind(-1)
        initial = torch.zeros(self.sizes[0], dtype=FLOAT)
        for state, probability in self.first().items():
            initial[state] = probability
        deviation = torch.tensor([self.deviation(*pair) for pair in pairs], dtype=FLOAT)
        final = torch.tensor([not row for row in listed]).view(self.sizes).all(1)
        return OutcomeMDP(probabilities, then.long(), rewards, deviation, initial, final)

    def problem(self, window: int | None, seeds: tuple[int, ...], device: torch.device | str = "cpu") -> Problem:
        """S, A, T (the whole episode where it is None), the horizon and the seeds."""
        return replace(super().problem(window or self.horizon, seeds, device), horizon=self.horizon)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make the streams of K copies of R replicas."""
        super().start(problem, copies, purpose)
        mdp = self.mdp
        self._successors, self._rewards = mdp.next_states.to(problem.device), mdp.rewards.to(problem.device)
        self._cumulative = cumulative(mdp.probabilities).to(problem.device)
        self._deviation = mdp.deviation.to(problem.device) if mdp.deviation.any() else None
        self._final = mdp.final.to(problem.device)
        self._noise = Stream(problem, f"reward, {purpose}", "normal", copies * problem.window)
        self._noises: tuple[Tensor, ...] = ()  # of a window, [R, K] a step

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """Draw s' from P(·|s, a), and see whether the episode ends there."""
        out = super().step(actions, mask)
        return out._replace(terminated=self._final[out.states])

    def _draw(self, row: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        which = successor(self._cumulative[row], uniform)
        rewards = self._rewards[row, which]
        if self._deviation is not None:
            if self._used == 0:  # as the numbers of the steps, so that none depends on how long others last
                self._noises = self._noise.next().view(*row.shape, -1).movedim(2, 0).unbind()
            rewards = rewards + self._deviation[row] * self._noises[self._used]
        return self._successors[row, which], rewards

    def truth(self, objective: str, window: int) -> EpisodicTruth | None:
        """V* and the value of policies for the sum of rewards; what else a label may show is judged by rollouts."""
        return self.mdp.pairs.truth(window) if objective == "sum" else None

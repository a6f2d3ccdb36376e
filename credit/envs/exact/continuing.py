"""Exact tabular MDPs: what is true about one, copies of it side by side, and a Gymnasium face."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import gymnasium
import torch
from torch import Tensor

from credit.core.compiled import usable
from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import Problem
from credit.core.truth import ContinuingTruth
from credit.envs.exact import loops
from credit.envs.exact.base import ExactEnvironment, cumulative, successor
from credit.planning import solve


@dataclass(frozen=True)
class TabularMDP:
    """P [S, A, S], r [S, A] per step, initial distribution [S]: the truth, which no learner sees.

    Raises:
        UserError: a row of P is no distribution.
    """

    transition: Tensor
    reward: Tensor
    initial: Tensor

    def __post_init__(self) -> None:
        rows = self.transition.sum(-1)
        bad = ((rows - 1).abs() > 1e-9) | (self.transition < 0).any(-1)
        if bad.any():
            s, a = (int(i) for i in bad.nonzero()[0])
            raise UserError(
                f"transition row (s={s}, a={a}) is no distribution: {self.transition[s, a].tolist()}, sum "
                f"{float(rows[s, a]):.6g}; entries must lie in [0, 1] and sum to 1"
            )

    @property
    def states(self) -> int:
        """S."""
        return self.transition.shape[0]

    @property
    def actions(self) -> int:
        """A."""
        return self.transition.shape[1]

    def backup(self, values: Tensor) -> Tensor:
        """The expected next value Σ P(s'|s, a) v(s') [..., S, A] of values [..., S]."""
        return expected(self.transition, values)

    @property
    def transitions(self) -> KnownTransitions:
        """P alone, without a way back to the rewards."""
        return KnownTransitions(partial(expected, self.transition))

    @cached_property
    def optimal(self) -> solve.Plan:
        """g*, h*, π* and action values of the average-reward criterion (42), without the replica dimension."""
        return solve.average_optimum(self.transition, self.reward)

    @cached_property
    def occupancy(self) -> Tensor:
        """The stationary distribution [S] of π*."""
        return solve.stationary(self.transition, self.optimal.policy, self.initial)

    def gains(self, policies: Tensor) -> Tensor:
        """The average reward of a step [R], where there are several that from the start on.

        Args:
            policies: actions [R, S], or probabilities of actions [R, S, A].
        """
        chances = policies.cpu() if policies.dim() == 3 else torch.nn.functional.one_hot(policies.cpu(), self.actions)
        first, found = torch.zeros(self.states, dtype=torch.int64), list[Tensor]()
        for own in chances.to(self.reward):
            chain = torch.einsum("sa,sat->st", own, self.transition).unsqueeze(1)  # a task of one action
            found.append((solve.stationary(chain, first, self.initial) * (own * self.reward).sum(-1)).sum())
        return torch.stack(found)

    @cached_property
    def diameter(self) -> float:
        """D of appendix C.1.1, in steps."""
        return solve.diameter(self.transition)


def expected(transition: Tensor, values: Tensor) -> Tensor:
    """Σ P(s'|s, a) v(s') [..., S, A] of P [S, A, S] and values [..., S]."""
    return torch.einsum("sat,...t->...sa", transition, values)


class TabularEnvironment(ExactEnvironment):
    """Copies of one exact continuing MDP."""

    setting: ClassVar = "continuing"

    @property
    @abstractmethod
    def mdp(self) -> TabularMDP:
        """The exact MDP."""

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make the streams of K copies of R replicas."""
        super().start(problem, copies, purpose)
        self._reward = self.mdp.reward.flatten().to(problem.device)
        self._cumulative = cumulative(self.mdp.transition.flatten(0, 1)).to(problem.device)

    def _draw(self, row: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        return successor(self._cumulative[row], uniform), self._reward.take(row)

    @property
    def follows(self) -> bool:
        """Between two windows, where loops are compiled."""
        return self._used == self._window and usable(self._states)

    def follow(self, table: Tensor, windows: int) -> tuple[Tensor, ...]:
        """What `step` gives, by a loop."""
        path = loops.follow(table, self._states, self._cumulative, self._stream.several(windows))
        states, actions, arrivals = torch.from_numpy(path).unbind()
        self._states = arrivals[:, -1:].contiguous()
        return states, actions, arrivals, self._reward.take(torch.add(actions, states, alpha=self._actions))

    def truth(self, objective: str, window: int) -> ContinuingTruth:
        """g*, π*, its occupancy, and r.

        Raises:
            UserError: the label is about anything but the sum of rewards.
        """
        if objective != "sum":
            raise UserError(
                f"{type(self).__name__} goes on for ever, where regret is that of the average reward, and the feedback "
                f"asks for {objective!r}; choose a feedback whose objective is 'sum', like block_sum"
            )
        mdp = self.mdp
        return ContinuingTruth(float(mdp.optimal.gain), mdp.optimal.policy, mdp.occupancy, mdp.reward, mdp.gains)


class TabularGymEnv(gymnasium.Env[int, int]):
    """One copy of a tabular MDP as a Gymnasium environment; `reward` is the primitive reward.

    Example:
        >>> env = gymnasium.make("credit/Advertiser-v0")
        >>> state, info = env.reset(seed=0)
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's own field

    def __init__(self, mdp: TabularMDP, render_mode: str | None = None) -> None:
        self.mdp = mdp
        self.render_mode = render_mode
        states, actions, _ = mdp.transition.shape
        self.observation_space = gymnasium.spaces.Discrete(states)  # type: ignore[assignment]
        self.action_space = gymnasium.spaces.Discrete(actions)  # type: ignore[assignment]
        self._transition = mdp.transition.numpy()
        self._state = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Draw an initial state."""
        super().reset(seed=seed)
        self._state = int(self.np_random.choice(len(self.mdp.initial), p=self.mdp.initial.numpy()))
        return self._state, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Draw s' from P(·|s, a); the task is continuing, so it never terminates."""
        reward = float(self.mdp.reward[self._state, action])
        self._state = int(self.np_random.choice(len(self.mdp.initial), p=self._transition[self._state, action]))
        return self._state, reward, False, False, {}

    def render(self) -> str | None:
        """The state as one line of text."""
        if self.render_mode != "ansi":
            return None
        return "".join("●" if s == self._state else "·" for s in range(len(self.mdp.initial)))

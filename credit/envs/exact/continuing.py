"""Exact tabular MDPs: what is true about one, R replicas of it side by side, and a Gymnasium face."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import gymnasium
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Act, Rollout
from credit.core.store import Windows
from credit.core.streams import Stream
from credit.core.truth import ContinuingTruth
from credit.envs.exact.base import ExactEnvironment
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

    @cached_property
    def optimal(self) -> solve.Plan:
        """g*, h*, π* and action values of the average-reward criterion (42), without the replica dimension."""
        return solve.average_optimum(self.transition, self.reward)

    @cached_property
    def occupancy(self) -> Tensor:
        """The stationary distribution [S] of π*."""
        return solve.stationary(self.transition, self.optimal.policy, self.initial)

    @cached_property
    def diameter(self) -> float:
        """D of appendix C.1.1, in steps."""
        return solve.diameter(self.transition)


class TabularEnvironment(ExactEnvironment):
    """R replicas of one exact continuing MDP.

    Args:
        poison: replace the primitive reward by NaN wherever a learner could read it.
    """

    setting: ClassVar = "continuing"
    keeps: ClassVar = ("_stream", "_states")

    @property
    @abstractmethod
    def mdp(self) -> TabularMDP:
        """The exact MDP."""

    def start(self, problem: Problem) -> None:
        """Draw the initial states."""
        mdp = self.mdp
        self._actions = problem.actions
        self._reward = mdp.reward.flatten().to(problem.device)
        self._cumulative = _cumulative(mdp.transition.flatten(0, 1)).to(problem.device)
        self._initial = _cumulative(mdp.initial).to(problem.device)
        self._stream = Stream(problem, "environment", "uniform", problem.window)
        first = Stream(problem, "initial state", "uniform", 1).next()
        self._states = _invert(self._initial, first)
        self._clock = self.clock(problem)

    def run(self, act: Act, windows: int, steps: int) -> Rollout:
        """Follow a policy from where the last window ended."""
        states, actions, arrivals = [], [], []
        now = self._states
        for _ in range(windows):
            uniform = self._stream.next().unsqueeze(-1)
            for t in range(steps):
                action = act.act(now.unsqueeze(1), self._clock[t]).squeeze(1)
                then = (self._cumulative[now * self._actions + action] <= uniform[:, t]).sum(-1)
                states.append(now)
                actions.append(action)
                arrivals.append(then)
                now = then
        self._states = now
        s, a, n = (torch.stack(part, dim=1) for part in (states, actions, arrivals))
        primitive = self._reward[s * self._actions + a]
        rewards = primitive.unflatten(1, (windows, steps))
        found = Windows(s, a, n, labels=rewards[..., 0], length=steps)
        return Rollout(found, primitive * torch.nan if self.poison else primitive, rewards)

    def truth(self, objective: str, problem: Problem) -> ContinuingTruth:
        """Gain and policy that are best by the average reward.

        Raises:
            UserError: labels show something else than the sum of rewards.
        """
        if objective != "sum":
            raise UserError(
                f"feedback: its objective is {objective!r}, and in a task that goes on for ever regret is known for "
                "the sum of rewards alone; choose feedback=block_sum"
            )
        mdp = self.mdp
        reward = mdp.reward * torch.nan if self.poison else mdp.reward
        return ContinuingTruth(float(mdp.optimal.gain), mdp.optimal.policy, mdp.occupancy, reward)


def _cumulative(rows: Tensor) -> Tensor:
    total = rows.cumsum(-1)
    total[..., -1] = torch.inf  # rounding must not lead past the last state
    return total


def _invert(cumulative: Tensor, uniform: Tensor) -> Tensor:
    return (cumulative <= uniform).sum(-1)


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

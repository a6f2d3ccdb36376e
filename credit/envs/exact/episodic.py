"""Exact finite-horizon MDPs with few successors a row: the truth, copies side by side, and a Gymnasium face."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import gymnasium
import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import FLOAT, Problem
from credit.core.truth import EpisodicTruth
from credit.envs.exact.base import ExactEnvironment, cumulative, require_distributions, successor
from credit.planning.horizon import backward, steps, worth


@dataclass(frozen=True)
class SuccessorMDP:
    """P as successor lists, r(s') and the initial distribution: the truth, which no learner sees.

    Row n = s·A + a of P lists W states and their probabilities; entries of probability zero are padding, wherever
    they stand. Objectives are `additive`, the sum of r(s_{t+1}) over the window, or terminal, r(s_T).

    Args:
        next_states: [N, W] int64. probabilities: [N, W]. reward_next: r(s') [S]. initial: [S].

    Raises:
        UserError: a row of P, or the initial distribution, is no distribution.
    """

    next_states: Tensor
    probabilities: Tensor
    reward_next: Tensor
    initial: Tensor

    def __post_init__(self) -> None:
        require_distributions(self.probabilities, self.initial)

    @property
    def states(self) -> int:
        """S."""
        return self.initial.shape[0]

    @property
    def actions(self) -> int:
        """A."""
        return self.probabilities.shape[0] // self.states

    @cached_property
    def reward(self) -> Tensor:
        """The expected primitive reward r(s, a) = Σ P(s'|s, a) r(s') [S, A] of a step."""
        return self.backup(self.reward_next)

    def backup(self, values: Tensor) -> Tensor:
        """The expected next value Σ P(s'|s, a) v(s') [..., S, A] of values [..., S]."""
        return expected(self._sparse, values)

    @property
    def transitions(self) -> KnownTransitions:
        """P alone, without a way back to the rewards."""
        return KnownTransitions(partial(expected, self._sparse))

    def optimal(self, horizon: int, additive: bool) -> tuple[Tensor, Tensor]:
        """The best values [T+1, S] and a policy [T, S] that attains them, of ties the first action.

        Raises:
            UserError: no step to plan.
        """
        return backward(partial(self._ahead, additive=additive), self._last(additive), horizon)

    def evaluate(self, policy: Tensor, additive: bool) -> Tensor:
        """The value [R] of policies under the initial distribution.

        Args:
            policy: actions [R, T, S] int64, or probabilities of actions [R, T, S, A]; T is the horizon.
            additive: whether the objective is the sum of rewards or the last one.

        Raises:
            UserError: no step to evaluate.
        """
        return worth(partial(self._ahead, additive=additive), self._last(additive), self.initial, policy)

    def _last(self, additive: bool) -> Tensor:
        return torch.zeros_like(self.reward_next) if additive else self.reward_next

    def _ahead(self, value: Tensor, additive: bool) -> Tensor:
        return self.backup(self.reward_next + value if additive else value)

    @cached_property
    def _sparse(self) -> csr_array:
        possible = self.probabilities > 0
        rows = possible.nonzero()[:, 0]
        cells = (rows.numpy(), self.next_states[possible].numpy())
        return csr_array((self.probabilities[possible].numpy(), cells), shape=(len(possible), self.states))


def expected(transition: csr_array, values: Tensor) -> Tensor:
    """Σ P(s'|s, a) v(s') [..., S, A] of a sparse P [S·A, S] and values [..., S]."""
    pairs, states = transition.shape
    # N × (R·S) chosen rows would be gathered at full width W; the sparse product reads each non-zero once.
    ahead = torch.from_numpy(transition @ values.reshape(-1, states).T.cpu().numpy()).T
    return ahead.reshape(*values.shape, pairs // states)


class EpisodicEnvironment(ExactEnvironment):
    """Copies of one exact MDP; every window starts from the initial distribution."""

    setting: ClassVar = "episodic"
    rolls: ClassVar = False

    @property
    @abstractmethod
    def mdp(self) -> SuccessorMDP:
        """The exact MDP."""

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make the streams of K copies of R replicas."""
        super().start(problem, copies, purpose)
        self._reward = self.mdp.reward_next.to(problem.device)
        self._successors = self.mdp.next_states.to(problem.device)
        self._cumulative = cumulative(self.mdp.probabilities).to(problem.device)

    def _draw(self, row: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        then = self._successors[row, successor(self._cumulative[row], uniform)]
        return then, self._reward.take(then)

    def truth(self, objective: str, window: int) -> EpisodicTruth:
        """V* and the value of policies, for the sum of rewards or for the last one.

        Raises:
            UserError: the label is about something else.
        """
        if objective not in ("sum", "last"):
            raise UserError(
                f"the feedback asks for {objective!r}, and the regret in {type(self).__name__} is known for the sum of "
                "rewards (objective 'sum') and for the last one ('last'); choose a feedback with one of these"
            )
        mdp, additive = self.mdp, objective == "sum"
        values, _ = mdp.optimal(window, additive)
        uniform = torch.full((1, window, mdp.states, mdp.actions), 1 / mdp.actions, dtype=FLOAT)

        def table(cells: Cells) -> Tensor:
            known = cells.known(mdp.reward, mdp.reward_next)
            counts = cells.steps(known.device).times == window - 1
            return known if additive or "step" not in cells.axes else known * counts

        return EpisodicTruth(
            best=float(values[0] @ mdp.initial),
            random=float(mdp.evaluate(uniform, additive)),
            table=table,
            evaluate=partial(mdp.evaluate, additive=additive),
        )


class EpisodicGymEnv(gymnasium.Env[int, int]):
    """One copy of an episodic MDP as a Gymnasium environment; `reward` is the primitive reward r(s').

    The last step is `terminated`, not `truncated`: the horizon belongs to the task, and no value lies behind it that
    a learner should bootstrap from. `info["step"]` is the number of steps taken.

    Raises:
        UserError: no step to take, an action that does not exist, a step after the end.
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi"], "render_fps": 1}  # noqa: RUF012 - Gymnasium's own field

    def __init__(self, mdp: SuccessorMDP, horizon: int, render_mode: str | None = None) -> None:
        self.mdp = mdp
        self.horizon = steps(horizon)
        self.render_mode = render_mode
        self.observation_space = gymnasium.spaces.Discrete(mdp.states)  # type: ignore[assignment]
        self.action_space = gymnasium.spaces.Discrete(mdp.actions)  # type: ignore[assignment]
        self._probabilities = mdp.probabilities.numpy()
        self.state, self.taken = 0, 0

    def info(self) -> dict[str, Any]:
        """What `reset` and `step` tell beside the state."""
        return {"step": self.taken}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Draw an initial state."""
        super().reset(seed=seed)
        self.state = int(self.np_random.choice(self.mdp.states, p=self.mdp.initial.numpy()))
        self.taken = 0
        return self.state, self.info()

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Draw s' from P(·|s, a)."""
        if not self.action_space.contains(action):
            raise UserError(f"action={action!r}: allowed are 0 to {self.mdp.actions - 1}")
        if self.taken == self.horizon:
            raise UserError(f"the episode ended after {self.horizon} steps; call reset() first")
        row = self.state * self.mdp.actions + int(action)
        choice = self.np_random.choice(self._probabilities.shape[1], p=self._probabilities[row])
        self.state = int(self.mdp.next_states[row, choice])
        self.taken += 1
        return self.state, float(self.mdp.reward_next[self.state]), self.taken == self.horizon, False, self.info()

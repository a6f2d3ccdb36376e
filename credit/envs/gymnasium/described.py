"""What single environments with Gymnasium's face say of themselves: spaces, limits, and whether they tell a success."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from torch import Tensor

from credit.core.component import Setting
from credit.core.errors import UserError, nearest
from credit.core.problem import Problem
from credit.core.seams import Environment
from credit.envs import inverse, spaces
from credit.envs.facts import REWARD, SUCCESS, looked_for
from credit.envs.gymnasium.copies import Make, Raised, first, out, told

TRIED = 200  # steps of a first try


class Described(Environment):
    """Single environments, of which a class says how one is made: by `called`, `limit` and `_make`.

    Observations and actions are encoded by `credit.envs.spaces`. Episodes end by termination, by the time limit, or not
    at all. A class of this kind takes these keys, with the same names:

    Args:
        max_steps: most steps of an episode; None: the environment has a limit of its own.
        horizon: steps of an evaluation, where episodes never end: then no limit holds, and the task goes on for ever.
        copies: K, episodes that run side by side; None for as many as are collected at once.
        workers: processes that step them; 0 for this one.
        view: whether observations are seen as a number or as a vector; `auto`: a number where there are few.
        success: the key of `info` that says whether a step is a success; `auto` looks for `success`, `is_success`;
            `reward`: a step with a positive reward is one.
        evaluation_episodes: of each replica, in each evaluation by rollouts.
        names: of the coordinates of an observation as learners see it, for feature maps; None: s0, s1, …

    Raises:
        UserError: both a limit and a task that goes on for ever.
    """

    def __init__(
        self,
        max_steps: int | None,
        horizon: int | None,
        copies: int | None,
        workers: int,
        view: spaces.View,
        success: str,
        evaluation_episodes: int,
        names: Sequence[str] | None,
    ) -> None:
        if max_steps is not None and horizon is not None:
            raise UserError(
                f"env.max_steps={max_steps} ends episodes, and env.horizon={horizon} says that they never end and how "
                "long an evaluation is; give one of the two"
            )
        self.max_steps, self.endless = max_steps, horizon
        self.copies, self.workers = copies, workers
        self.view: spaces.View = view
        self.success = success
        self.evaluation_episodes = evaluation_episodes
        self.names = names

    @property
    @abstractmethod
    def called(self) -> str:
        """The key that a user types, and what stands there: `env.id='CartPole-v1'`."""

    @property
    @abstractmethod
    def limit(self) -> int | None:
        """Most steps of an episode as the environment says it, None where it does not."""

    @property
    @abstractmethod
    def _make(self) -> Make:
        """What makes one of them, under `max_steps` or without a limit; it can be sent to another process."""

    def problem(self, window: int | None, seeds: tuple[int, ...], device: torch.device | str = "cpu") -> Problem:
        """Spaces as they are encoded; an episode lasts for the time limit at most, and so does a window.

        Raises:
            UserError: no such environment, a space that nobody takes, no time limit; or a window longer than an
                evaluation.
        """
        seen, done = self._encoders
        most = self.endless or self.horizon
        assert most is not None
        if self.endless and (window or 1) > most:
            raise UserError(
                f"feedback.window={window}: an evaluation has env.horizon={most} steps; take at most as many, or a "
                f"longer one, such as env.horizon={10 * (window or 1)}"
            )
        episodic = not self.endless
        return spaces.problem(seen, done, window or most, seeds, device, episodic, most)

    @cached_property
    def horizon(self) -> int | None:  # type: ignore[override]
        """Most steps of an episode, None where none ends.

        Raises:
            UserError: there is no limit.
        """
        if self.endless:
            return None
        if (limit := self.max_steps or self.limit) is None:
            raise UserError(
                f"{self.called} comes without a time limit, and an evaluation must end: give env.max_steps=<most steps "
                "of an episode>; or, if its episodes never end, env.horizon=<steps of an evaluation>"
            )
        return int(limit)

    @property
    def setting(self) -> Setting:  # type: ignore[override]
        """Whether there are episodes."""
        return "continuing" if self.endless else "episodic"

    @property
    def ends_early(self) -> bool:  # type: ignore[override]
        """Whether an episode may end before its window does."""
        return not self.endless

    @cached_property
    def _one(self) -> gymnasium.Env[Any, Any]:
        """One of them, to look at."""
        return self._make()

    @cached_property
    def _encoders(self) -> tuple[spaces.Observations, spaces.Actions]:
        env = self._one
        try:
            return spaces.observations(env.observation_space, self.view), spaces.actions(env.action_space)
        except UserError as error:
            raise UserError(f"{self.called}: {error}{self.hint}") from None

    def states_of(self, observations: Any) -> Tensor:
        """Encoded observations."""
        return self._encoders[0](inverse.require("observation", self._one.observation_space, observations))

    def impossible(self, states: NDArray[Any]) -> NDArray[np.bool_]:
        """Far outside the bounds of the observation space, which last observations of episodes may leave a little."""
        space = self._one.observation_space
        if not isinstance(space, Box) or states.shape[1:] != (space.low.size,):
            return super().impossible(states)
        low, high = space.low.ravel().astype(float), space.high.ravel().astype(float)
        span = high - low
        return np.asarray(((states < low - span) | (states > high + span)).any(-1))

    def actions_of(self, actions: Any) -> Tensor:
        """Numbers, or vectors in [−1, 1]."""
        return inverse.actions_of(self._one.action_space, actions)

    def recorded(self, actions: Tensor) -> Tensor:
        """As the environment's space has them."""
        return self._encoders[1](actions)

    @property
    def hint(self) -> str:
        """What helps where a space is not taken."""
        return ""

    @property
    def facts(self) -> tuple[str, ...]:  # type: ignore[override]
        """Success, where it is told."""
        return ("success",) if self.success == REWARD or self._reports is not None else ()

    def tells(self, fact: str) -> str:
        """How success may be told."""
        keys = ", ".join(SUCCESS)
        return (
            f"env.success=auto looks for one of the keys {keys} in the info of {self.called}; name another by "
            "env.success=KEY, say env.success=reward if a positive reward is one, or choose another feedback"
        )

    @cached_property
    def _reports(self) -> str | None:
        """The key of `info` under which success is reported, None where it is not."""
        if self.success != "auto":
            return next(iter(looked_for(self.success)), None)
        env = self._one
        try:
            first(0, told(env.reset, 0, seed=0))
            env.action_space.seed(0)
            info = out(0, told(env.step, 0, env.action_space.sample())).info
        except Raised as error:
            raise UserError(f"{self.called} {error.did} {error.method}, of a first try: {error.what}") from error
        return next((key for key in SUCCESS if key in info), None)

    def remark(self) -> str:
        """How a task that goes on for ever is gone on with; and whether a key that was named is told."""
        never = f"{self.called} never ends: a run that was stopped goes on by playing all its steps again"
        return "; ".join([*([never] if self.endless else []), *filter(None, [self._untold()])])

    def _untold(self) -> str:
        """What to say where a first try hears nothing of the key that `success` names; successes alone may have it."""
        if self.success in ("auto", REWARD):
            return ""
        env, told_keys = self._one, dict[str, None]()
        env.action_space.seed(0)
        with suppress(Raised):  # which the run will tell, with where it was
            first(0, told(env.reset, 0, seed=0))
            for steps in range(1, TRIED + 1):
                step = out(0, told(env.step, 0, env.action_space.sample()))
                if self.success in step.info:
                    return ""
                told_keys |= dict.fromkeys(map(str, step.info))
                if step.terminated or step.truncated or steps == TRIED:
                    return (
                        f"env.success={self.success}: {self.called} told no such key in {steps} steps of a first try; "
                        f"{nearest(self.success, told_keys)}; where it never comes, the run ends with its first episode"
                    )
        return ""

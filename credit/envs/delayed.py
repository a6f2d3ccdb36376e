"""Late labels for any agent: a Gymnasium wrapper that keeps the reward, and tells its labels."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import gymnasium
import torch
from gymnasium.utils import RecordConstructorArgs

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Feedback
from credit.envs.labeller import Labeller

OWN = ("label", "window_end", "censored")  # keys of `info` that are ours


class DelayedReward(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The label of a window in place of its rewards: at its last step, and 0 before it.

    A window has T steps, as many as are drawn, or is a whole episode, as the feedback has it; an episode begins a new
    one. One that an episode's end cuts short, and labels that are missing, are as the feedback has them, too.
    `info` has `window_end` and `censored`, whether a window ended without a label, in every step, and `label` where
    there is one. All else that the environment tells there is left out: many repeat the reward in it.

    Args:
        env: whose rewards are kept.
        feedback: what makes labels; it is copied, so that several environments may be given the same.
        seed: of the feedback's random numbers; give each of several environments its own. `reset(seed=…)` seeds the
            environment alone.
        keep: keys of the environment's `info` to tell all the same.
        success: the key of `info` that says whether a step is a success, for a feedback that reads it; `auto` looks for
            `success`, `is_success`; `reward`: a step with a positive reward is one.

    Attributes:
        label_window: most steps of a window; None where that is an episode without a time limit.

    Raises:
        UserError: a key to keep is one of ours; or labels that come late, which an agent's step cannot wait for; a
            `success` that the feedback does not read.

    Example:
        >>> env = DelayedReward(gymnasium.make("Pendulum-v1"), BlockSum(window=20, noise=0.0))
        >>> observation, reward, terminated, truncated, info = env.step(action)
        >>> info.get("label")  # in every 20th step
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        feedback: Feedback,
        seed: int = 0,
        keep: Sequence[str] = (),
        success: str = "auto",
    ) -> None:
        if own := sorted({*keep} & {*OWN}):
            raise UserError(f"keep={list(keep)}: {own} are told by DelayedReward itself; leave them out")
        RecordConstructorArgs.__init__(self, feedback=feedback, seed=seed, keep=keep, success=success)
        gymnasium.Wrapper.__init__(self, env)
        self._feedback, self._keep = copy.deepcopy(feedback), tuple(keep)
        self.label_window: int | None = feedback.window or (env.spec.max_episode_steps if env.spec else None)
        spaces = env.observation_space, env.action_space
        whole = feedback.window is None
        problem = Problem(*spaces, self.label_window or 1, (seed,), torch.device("cpu"), whole)
        self._labeller = Labeller(self._feedback, problem, success)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """A new episode, and a new window; one that was open has no label."""
        observation, told = self.env.reset(seed=seed, options=options)
        self._labeller.begin()
        return observation, self._told(told)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The environment's step; the reward is the label where a window ends, and 0 elsewhere.

        Raises:
            RunError: a reward is not one finite number. UserError: a success is read, and nothing ever told one.
        """
        observation, reward, terminated, truncated, told = self.env.step(action)
        ended, label = self._labeller.step(reward, told, bool(terminated or truncated))
        info: dict[str, Any] = {**self._told(told), "window_end": ended, "censored": False}
        if ended:
            info |= {"censored": True} if label is None else {"label": label}
        return observation, label or 0.0, terminated, truncated, info

    def _told(self, told: dict[str, Any]) -> dict[str, Any]:
        return {name: told[name] for name in self._keep if name in told}

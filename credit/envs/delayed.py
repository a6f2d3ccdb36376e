"""Late labels for any agent: a Gymnasium wrapper that keeps the reward, and tells its labels."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import torch
from gymnasium.utils import RecordConstructorArgs

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Feedback
from credit.envs.gymnasium.environment import SUCCESS

Cut = Literal["label", "drop"]
OWN = ("label", "window_end", "censored")  # keys of `info` that are ours


class DelayedReward(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The label of a window in place of its rewards: at its last step, and 0 before it.

    A window has T steps, or is a whole episode where the feedback's window is None; an episode begins a new one.
    `info` has `window_end` and `censored`, whether a window ended without a label, in every step, and `label` where
    there is one. All else that the environment tells there is left out: many repeat the reward in it.

    Args:
        env: whose rewards are kept.
        feedback: what makes labels; it is copied, so that several environments may be given the same.
        seed: of the feedback's random numbers; give each of several environments its own. `reset(seed=…)` seeds the
            environment alone.
        cut: what a window comes to that an episode's end cut short: a label of the steps that there were, or none. A
            feedback that needs windows of T steps (`whole`) gives none.
        keep: keys of the environment's `info` to tell all the same.

    Attributes:
        label_window: most steps of a window; None where that is an episode without a time limit.

    Raises:
        UserError: a key to keep is one of ours.

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
        cut: Cut = "label",
        keep: Sequence[str] = (),
    ) -> None:
        if own := sorted({*keep} & {*OWN}):
            raise UserError(f"keep={list(keep)}: {own} are told by DelayedReward itself; leave them out")
        RecordConstructorArgs.__init__(self, feedback=feedback, seed=seed, cut=cut, keep=keep)
        gymnasium.Wrapper.__init__(self, env)
        self._feedback, self._cut, self._keep = copy.deepcopy(feedback), cut, tuple(keep)
        self.label_window: int | None = feedback.window or (env.spec.max_episode_steps if env.spec else None)
        spaces = env.observation_space, env.action_space
        whole = feedback.window is None
        self._feedback.start(Problem(*spaces, self.label_window or 1, (seed,), torch.device("cpu"), whole))
        self._rewards: list[float] = []  # of the window that is open
        self._fact: str | None = None  # the key of `info` that the feedback is shown
        self._asked = False  # whether the environment was seen to tell it

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """A new episode, and a new window; one that was open has no label."""
        observation, told = self.env.reset(seed=seed, options=options)
        self._rewards = []
        return observation, self._told(told)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The environment's step; the reward is the label where a window ends, and 0 elsewhere.

        Raises:
            RunError: a reward is not finite.
        """
        observation, reward, terminated, truncated, told = self.env.step(action)
        self._rewards.append(self._seen(reward, told))
        over, full = bool(terminated or truncated), len(self._rewards) == self._feedback.window
        info: dict[str, Any] = {**self._told(told), "window_end": full or over, "censored": False}
        label = None
        if full or over:
            label = self._label(full)
            self._rewards = []
            info |= {"censored": True} if label is None else {"label": label}
        return observation, label or 0.0, terminated, truncated, info

    def _seen(self, reward: Any, told: dict[str, Any]) -> float:
        """What the feedback is shown of a step: its reward, or a fact where the environment tells it."""
        value = float(reward)
        if not math.isfinite(value):
            raise RunError(f"reward {value} in step {len(self._rewards)} of a window: a label needs finite numbers")
        reads = self._feedback.reads
        if reads is not None and not self._asked:
            names = SUCCESS if reads == "success" else (reads,)
            self._fact, self._asked = next((name for name in names if name in told), None), True
        return value if self._fact is None else float(told.get(self._fact, 0.0))

    def _told(self, told: dict[str, Any]) -> dict[str, Any]:
        return {name: told[name] for name in self._keep if name in told}

    def _label(self, full: bool) -> float | None:
        """Y of the window that ends; None where it has none."""
        cut_short = self._feedback.window is not None and not full
        if cut_short and (self._cut == "drop" or self._feedback.whole):
            return None
        rewards = torch.tensor(self._rewards, dtype=FLOAT)
        if not self._feedback.whole and self.label_window is not None:  # as the collector has it
            rewards = torch.nn.functional.pad(rewards, (0, max(self.label_window - len(rewards), 0)))
        label = float(self._feedback(rewards.view(1, 1, -1)))
        return label if math.isfinite(label) else None

"""Windows of one environment that is stepped by somebody else, and their labels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Feedback
from credit.core.streams import Queues
from credit.envs.facts import REWARD, looked_for, number


class Labeller:
    """Steps of one environment → labels where windows end: of T steps, of as many as are drawn, or whole episodes.

    Args:
        feedback: what makes labels, for this alone. problem: of one seed.
        success: the key under which a success is told, for a feedback that reads it; `auto` looks for `success` and
            `is_success`, and `reward` says that a step with a positive reward is one.

    Attributes:
        keys: under which a fact may be told that the feedback is shown instead of the reward.

    Raises:
        UserError: labels that come late, which an agent's step cannot wait for; a key that nobody reads.
    """

    def __init__(self, feedback: Feedback, problem: Problem, success: str = "auto") -> None:
        if feedback.delay or feedback.delay_windows:
            raise UserError(
                f"feedback.delay={feedback.delay}, delay_windows={feedback.delay_windows}: here a label comes with the "
                "last step of its window; set both to 0, or train by credit, which waits"
            )
        if success != "auto" and feedback.reads != "success":
            raise UserError(
                f"success={success!r}: {type(feedback).__name__} does not read whether a step is one; leave it out, or "
                "take a feedback that does, like Success"
            )
        self._feedback, self._success = feedback, success
        reads = feedback.reads
        self.keys = () if reads is None else looked_for(success) if reads == "success" else (reads,)
        self._heard = False  # whether one of them was ever told
        self._feedback.start(problem)
        self._missing, self._drawn = (
            Queues(problem, f"feedback, {what}", "uniform", 1) for what in ("missing", "window")
        )
        self._rewards: list[float] = []  # of the window that is open

    def begin(self) -> None:
        """Another window."""
        self._rewards, self._length = [], self._feedback.window
        if self._feedback.lengths is not None:
            least, most = self._feedback.lengths
            self._length = least + int(self._uniform(self._drawn) * (most - least + 1))

    def step(self, reward: Any, told: Mapping[str, Any], over: bool) -> tuple[bool, float | None]:
        """Whether the window ends with this step, and its label, if it has one.

        Args:
            reward: the primitive one. told: what the environment told beside it. over: whether the episode is.

        Raises:
            RunError: a reward, or a fact in its place, is not one finite number. UserError: no fact was ever told.
        """
        self._rewards.append(self._shown(self._finite("reward", reward), told))
        full, label = len(self._rewards) == self._length, None
        if full or over:
            if self.keys and not self._heard and (over or self._success == "auto"):
                raise self._never(told)
            label = self._label(full)
            self.begin()
        return full or over, label

    def _finite(self, what: str, value: Any) -> float:
        try:
            found = number(value)
        except ValueError:
            found = math.nan
        if not math.isfinite(found):
            place = f"step {len(self._rewards)} of a window"
            raise RunError(f"{what} {value!r} in {place}: a label needs finite numbers, one for each step")
        return found

    def _shown(self, reward: float, told: Mapping[str, Any]) -> float:
        """What the feedback is shown of a step: its reward, or a fact that the environment tells."""
        if self._success == REWARD:
            return float(reward > 0)
        if not self.keys:
            return reward
        key = next((key for key in self.keys if key in told), None)
        self._heard |= key is not None
        return 0.0 if key is None else self._finite(key, told[key])  # many tell a success in an episode's last step

    def _never(self, told: Mapping[str, Any]) -> UserError:
        name, what = type(self._feedback).__name__, self._feedback.reads
        there = f"the last step told {', '.join(sorted(map(str, told)))}" if told else "the last step told nothing"
        asked = "success=KEY names another, and success='reward' says that a positive reward is one"
        return UserError(
            f"{name} reads the fact {what!r}, and in a whole window no step told {' or '.join(self.keys)} ({there}); "
            f"{asked if what == 'success' else 'let the environment tell it, or take another feedback'}"
        )

    def _label(self, full: bool) -> float | None:
        """Y of the window that ends; None where it has none."""
        short = self._length is not None and not full
        rewards = torch.tensor(self._rewards, dtype=FLOAT)
        label = float(self._feedback.label(rewards.view(1, 1, -1), torch.tensor([[len(self._rewards)]])))
        missing = self._feedback.missing > 0 and self._uniform(self._missing) < self._feedback.missing
        dropped = short and (self._feedback.cut == "drop" or self._feedback.whole)
        return label if math.isfinite(label) and not missing and not dropped else None

    @staticmethod
    def _uniform(queue: Queues) -> float:
        return float(queue.take(torch.ones(1, 1, dtype=torch.bool)))

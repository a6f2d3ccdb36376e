"""Windows of one environment that is stepped by somebody else, and their labels."""

from __future__ import annotations

import math

import torch

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Feedback
from credit.core.streams import Queues


class Labeller:
    """Steps of one environment → labels where windows end: of T steps, of as many as are drawn, or whole episodes.

    Args:
        feedback: what makes labels, for this alone. problem: of one seed. longest: most steps of a window, if known.

    Raises:
        UserError: labels that come late, which an agent's step cannot wait for.
    """

    def __init__(self, feedback: Feedback, problem: Problem, longest: int | None) -> None:
        if feedback.delay or feedback.delay_windows:
            raise UserError(
                f"feedback.delay={feedback.delay}, delay_windows={feedback.delay_windows}: here a label comes with the "
                "last step of its window; set both to 0, or train by credit, which waits"
            )
        self._feedback, self._longest = feedback, longest
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

    def step(self, reward: float, shown: float, over: bool) -> tuple[bool, float | None]:
        """Whether the window ends with this step, and its label, if it has one.

        Args:
            reward: the primitive one. shown: what the feedback is shown. over: whether the episode is.

        Raises:
            RunError: a reward is not finite.
        """
        if not math.isfinite(reward):
            raise RunError(f"reward {reward} in step {len(self._rewards)} of a window: a label needs finite numbers")
        self._rewards.append(shown)
        full, label = len(self._rewards) == self._length, None
        if full or over:
            label = self._label(full)
            self.begin()
        return full or over, label

    def _label(self, full: bool) -> float | None:
        """Y of the window that ends; None where it has none."""
        short = self._length is not None and not full
        rewards = torch.tensor(self._rewards, dtype=FLOAT)
        if not self._feedback.whole and self._longest is not None:  # as the collector has it
            rewards = torch.nn.functional.pad(rewards, (0, max(self._longest - len(rewards), 0)))
        label = float(self._feedback.label(rewards.view(1, 1, -1), torch.tensor([[len(self._rewards)]])))
        missing = self._feedback.missing > 0 and self._uniform(self._missing) < self._feedback.missing
        dropped = short and (self._feedback.cut == "drop" or self._feedback.whole)
        return label if math.isfinite(label) and not missing and not dropped else None

    @staticmethod
    def _uniform(queue: Queues) -> float:
        return float(queue.take(torch.ones(1, 1, dtype=torch.bool)))

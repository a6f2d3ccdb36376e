"""The only place where a label is made."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor

from credit.core.problem import Problem
from credit.core.ranges import NonNegative, PositiveInt
from credit.core.seams import Feedback
from credit.core.streams import Stream


class BlockSum(Feedback):
    """The sum of the window's primitive rewards plus Gaussian noise (1), (24).

    Args:
        window: T, steps that share one label.
        noise: standard deviation of the label's noise, in units of reward.
    """

    objective: ClassVar = "sum"

    def __init__(self, window: PositiveInt = 7, noise: NonNegative = 0.2) -> None:
        self.window = window
        self.noise = noise

    def start(self, problem: Problem) -> None:
        """Make the noise stream."""
        self._stream = Stream(problem, "feedback", "normal", 1)

    def __call__(self, rewards: Tensor) -> Tensor:
        """Y = Σ_t r_t + ε for every window of rewards [R, K, T]."""
        return rewards.sum(-1) + self.noise * self._stream.several(rewards.shape[1])


class Terminal(Feedback):
    """The primitive reward of the window's last step alone: an endpoint outcome, no sum of anything (6.2).

    Args:
        window: T, steps that share one label.
    """

    objective: ClassVar = "last"
    whole: ClassVar = True

    def __init__(self, window: PositiveInt = 5) -> None:
        self.window = window

    def start(self, problem: Problem) -> None:
        """There is no noise."""

    def __call__(self, rewards: Tensor) -> Tensor:
        """Y = r_{T−1} for every window of rewards [R, K, T]."""
        return rewards[..., -1]


class Success(Feedback):
    """Whether the goal was reached, one bit for a whole episode (27).

    The environment says whether a step is a success (the fact `success`), or its reward is positive where it is one.

    Args:
        window: H, most steps of an episode.
    """

    setting: ClassVar = "episodic"
    objective: ClassVar = "success"
    kind: ClassVar = "bits"
    reads: ClassVar = "success"

    def __init__(self, window: PositiveInt = 300) -> None:
        self.window = window

    def start(self, problem: Problem) -> None:
        """There is no noise."""

    def __call__(self, rewards: Tensor) -> Tensor:
        """Y = 1 if any reward of an episode [R, K, T] is positive, else 0."""
        return (rewards > 0).any(-1).to(rewards.dtype)

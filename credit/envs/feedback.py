"""The only place where a label is made."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.ranges import NonNegative, NonNegativeInt, PositiveInt, Share
from credit.core.seams import Feedback
from credit.core.streams import Queues, Stream

Window = PositiveInt | list[PositiveInt]
Cut = Literal["label", "drop"]
RARE = 0.9  # share of missing labels from which on a user is told


class Labels(Feedback):
    """What all labels of ours have in common: windows, noise, and how they arrive.

    A class of your own gives `objective` and `rule`, and all of this comes with it.

    Args:
        window: T, steps that share one label; [least, most]: as many as are drawn anew for each window; None: a whole
            episode.
        noise: standard deviation of the label's noise, in units of the label.
        missing: share of the windows that never get their label.
        delay: steps after a window's end at which its label arrives. delay_windows: windows of the same copy that end
            before it does.
        cut: whether a window that an episode's end cuts short gets a label, or none (`drop`).

    Raises:
        UserError: lengths of windows that are no range.

    Example:
        >>> class Median(Labels):
        ...     objective = "median"
        ...     def rule(self, rewards):
        ...         return rewards.median(-1).values
    """

    def __init__(
        self,
        window: Window | None = None,
        noise: NonNegative = 0.0,
        missing: Share = 0.0,
        delay: NonNegativeInt = 0,
        delay_windows: NonNegativeInt = 0,
        cut: Cut = "label",
    ) -> None:
        if isinstance(window, Sequence):
            if len(window) != 2 or window[0] > window[1]:
                raise UserError(f"feedback.window={list(window)}: give T, or [least, most] for windows of any length")
            self.lengths = (window[0], window[1])
        self.window = window[1] if isinstance(window, Sequence) else window
        self.noise = noise
        self.missing = missing
        self.delay, self.delay_windows = delay, delay_windows
        self.cut = cut

    def start(self, problem: Problem) -> None:
        """Make the noise stream."""
        kind = Stream if problem.even else Queues
        self._noise: Stream | Queues = kind(problem, "feedback", "normal", 1)

    def __call__(self, rewards: Tensor) -> Tensor:
        """Y for every window of rewards [R, K, T], all of T steps."""
        found = self._ruled(rewards.flatten(0, 1)).view(rewards.shape[:2])
        return self._noisy(found, torch.ones_like(found, dtype=torch.bool))

    def label(self, rewards: Tensor, lengths: Tensor) -> Tensor:
        """Y = rule + ε [R, K] of windows with rewards [R, K, T] and lengths [R, K], 0 for none.

        Windows of the same length are given to the rule together, each without what lies behind its end: so a label
        depends on its own window alone, whatever the rule.
        """
        found = rewards.new_zeros(lengths.shape)
        for length in lengths.unique().tolist():
            if length:
                same = lengths == length
                found[same] = self._ruled(rewards[same][:, :length].contiguous())
        return self._noisy(found, lengths > 0)

    def remark(self) -> str:
        """How few labels come, where hardly any do."""
        if self.missing < RARE:
            return ""
        share = 1 / (1 - self.missing)
        return f"feedback.missing={self.missing}: of {share:.3g} windows one gets a label, all that is learned from"

    def _ruled(self, rewards: Tensor) -> Tensor:
        found = self.rule(rewards)
        if found.shape != rewards.shape[:1]:
            raise UserError(
                f"{type(self).__name__}.rule gave labels {list(found.shape)} for rewards {list(rewards.shape)}, and of "
                f"windows side by side [n, T] it must give one label each, {list(rewards.shape[:1])}"
            )
        return found

    def _noisy(self, labels: Tensor, real: Tensor) -> Tensor:
        if not self.noise:
            return labels
        if isinstance(self._noise, Queues):
            return labels + self.noise * self._noise.take(real).squeeze(-1)
        return labels + self.noise * self._noise.several(labels.shape[1])

    @abstractmethod
    def rule(self, rewards: Tensor) -> Tensor:
        """What labels are without noise [n], of n windows of the same length with rewards [n, T]."""


class BlockSum(Labels):
    """The sum of the window's primitive rewards plus Gaussian noise (1), (24).

    Args:
        window: T, steps that share one label.
        noise, missing, delay, delay_windows, cut: as all labels have them (`Labels`).
    """

    objective: ClassVar = "sum"

    def __init__(
        self,
        window: Window = 7,
        noise: NonNegative = 0.2,
        missing: Share = 0.0,
        delay: NonNegativeInt = 0,
        delay_windows: NonNegativeInt = 0,
        cut: Cut = "label",
    ) -> None:
        super().__init__(window, noise, missing, delay, delay_windows, cut)

    def rule(self, rewards: Tensor) -> Tensor:
        """Y = Σ_t r_t."""
        return rewards.sum(-1)


class EpisodeSum(Labels):
    """The sum of all primitive rewards of an episode.

    Args:
        window: H, most steps of an episode; None takes the environment's own limit.
        noise, missing, delay, delay_windows, cut: as all labels have them (`Labels`).
    """

    objective: ClassVar = "sum"

    def rule(self, rewards: Tensor) -> Tensor:
        """Y = Σ_t r_t."""
        return rewards.sum(-1)


class Mean(Labels):
    """The mean of the window's primitive rewards.

    Args:
        window: T, steps that share one label; None: a whole episode.
        noise, missing, delay, delay_windows, cut: as all labels have them (`Labels`).
    """

    objective: ClassVar = "sum"

    def rule(self, rewards: Tensor) -> Tensor:
        """Y = Σ_t r_t / T, of as many steps as there were."""
        return rewards.mean(-1)


class Terminal(Labels):
    """The primitive reward of the window's last step alone: an endpoint outcome, no sum of anything (6.2).

    Args:
        window: T, steps that share one label; None: a whole episode.
        noise, missing, delay, delay_windows, cut: as all labels have them (`Labels`).
    """

    objective: ClassVar = "last"

    def __init__(
        self,
        window: Window | None = 5,
        noise: NonNegative = 0.0,
        missing: Share = 0.0,
        delay: NonNegativeInt = 0,
        delay_windows: NonNegativeInt = 0,
        cut: Cut = "label",
    ) -> None:
        super().__init__(window, noise, missing, delay, delay_windows, cut)

    def rule(self, rewards: Tensor) -> Tensor:
        """Y = r_{T−1}, of the last step that there was."""
        return rewards[:, -1]


class Success(Labels):
    """Whether the goal was reached, one bit for a whole episode (27).

    The environment says whether a step is a success (the fact `success`), or its reward is positive where it is one.

    Args:
        window: H, most steps of an episode; None takes the environment's own limit.
        missing, delay, delay_windows, cut: as all labels have them (`Labels`).
    """

    objective: ClassVar = "success"
    setting: ClassVar = "episodic"
    kind: ClassVar = "bits"
    reads: ClassVar = "success"

    def __init__(
        self,
        window: Window | None = 300,
        missing: Share = 0.0,
        delay: NonNegativeInt = 0,
        delay_windows: NonNegativeInt = 0,
        cut: Cut = "label",
    ) -> None:
        super().__init__(window, 0.0, missing, delay, delay_windows, cut)

    def rule(self, rewards: Tensor) -> Tensor:
        """Y = 1 if any reward of an episode is positive, else 0."""
        return (rewards > 0).any(-1).to(rewards.dtype)

"""The border: the one place where primitive rewards meet the feedback. Behind it there are labels alone."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import Act, Environment, Feedback
from credit.core.state import Stateful
from credit.core.store import Windows


class Collector(Stateful):
    """Runs policies in an environment and labels what came of it.

    Args:
        env: where steps happen, started. feedback: what a label is, started. problem: T.
    """

    keeps: ClassVar = ()

    def __init__(self, env: Environment, feedback: Feedback, problem: Problem) -> None:
        self._env, self._feedback, self._window = env, feedback, problem.window

    def collect(self, act: Act, windows: int, steps: int | None = None) -> tuple[Windows, Tensor]:
        """Labelled windows, and apart from them their primitive rewards [R, n], for a judge.

        Args:
            act: what acts. windows: K, of each replica. steps: of each window at most; T by default.
        """
        found = self._env.run(act, windows, self._window if steps is None else steps)
        labels = self._feedback(found.rewards)
        return replace(found.windows, labels=labels, primitive=None), found.primitive

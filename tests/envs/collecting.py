"""Collectors for tests: environments followed by functions, and what they collect."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams import Environment, Feedback
from credit.core.windows import Windows
from credit.envs.collect import Collector

Function = Callable[[Tensor, Tensor], Tensor]  # states [R, K, ...], step [R, K] → actions [R, K, ...]


class Follow(Policy):
    """Acts by a function."""

    def __init__(self, function: Function) -> None:
        self._function = function

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        return self._function(states, step)


def begun(env: Environment, feedback: Feedback, seeds: tuple[int, ...] = (0,)) -> tuple[Collector, Problem]:
    """A collector, with everything started."""
    problem = env.problem(feedback.window, seeds, "cpu")
    env.start(problem)
    feedback.start(problem)
    return Collector(env, feedback, problem), problem


def collected(
    env: Environment,
    feedback: Feedback,
    seeds: tuple[int, ...],
    function: Function,
    windows: int,
    steps: int | None = None,
) -> tuple[Windows, Tensor]:
    """Windows from a fresh start, and their primitive rewards as a grid [R, K, T]."""
    found, primitive = begun(env, feedback, seeds)[0].collect(Follow(function), windows, steps)
    return found, found.grid(primitive)

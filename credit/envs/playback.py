"""Steps that were taken before, as labelled windows: cut and labelled as the run's own feedback would have done."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from credit.core.checks import check_windows
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Environment, Feedback, Transitions
from credit.core.streams import reset_seed
from credit.core.windows import Windows
from credit.data.logged import Logged
from credit.envs.rolling import Rolling

Found = tuple[Windows, Tensor | None]  # and the primitive reward of each row, where it is known
SEED = reset_seed(0, "demonstrations", 0, 0)  # all replicas are given the same noise of labels, and none of their own


def windows_of(logged: Logged, feedback: Feedback, problem: Problem) -> Found:
    """The windows of logged steps, the same for every replica, and r [R, n] of their rows, where it is known.

    Args:
        logged, feedback, problem: as in `alone`.
    """
    return for_all(alone(logged, feedback, problem), problem.replicas)


def for_all(found: Found, replicas: int) -> Found:
    """Windows of one replica, and their rewards, for R of them."""
    windows, primitive = found
    parts: dict[str, Any] = {field.name: getattr(windows, field.name) for field in fields(windows)}
    every: dict[str, Any] = {name: _repeated(x, replicas) if isinstance(x, Tensor) else x for name, x in parts.items()}
    return Windows(**every), None if primitive is None else _repeated(primitive, replicas)


def alone(logged: Logged, feedback: Feedback, problem: Problem) -> Found:
    """The windows of logged steps of one replica, whatever its seed, and r [1, n] of their rows, where it is known.

    Labels that came with the steps stay; else the feedback makes them of the rewards, all of them at once: what is late
    in a run has come. Windows lie inside episodes. Where a problem's windows all have T steps and a label, what an
    episode leaves behind its last window is no part of any, and is left out.

    Args:
        logged: steps that fit the problem. feedback: the run's own; it is not touched. problem: of the run.

    Raises:
        UserError: windows that this run cannot have; labels that must be bits, and are not; nothing is left.
    """
    one = replace(problem, seeds=(SEED,))
    windows, primitive = _given(logged, one) if logged.labels is not None else _made(logged, feedback, one)
    if problem.labels == "bits" and (odd := ~((windows.labels == 0) | (windows.labels == 1))).any():
        k = int(odd[0].int().argmax())
        raise UserError(
            f"{logged.source}: the label of the window that ends with {logged.where(int(windows.ends[0, k]))} is "
            f"{float(windows.labels[0, k]):g}, and this feedback's are bits: allowed are 0 and 1"
        )
    if problem.even:
        windows, primitive = _even(windows, primitive, logged, problem)
    check_windows(windows, one)
    return windows, primitive


def _given(logged: Logged, problem: Problem) -> Found:
    """Windows [1, K] with the labels that came with the steps."""
    assert logged.labels is not None
    assert logged.closes is not None
    last = np.flatnonzero(logged.closes)
    if (longest := int(np.diff(last, prepend=-1).max())) > problem.window:
        place = last[int(np.diff(last, prepend=-1).argmax())]
        raise UserError(
            f"{logged.source}: the window that ends with row {place} has {longest} steps, and here they have at most "
            f"{problem.window} (feedback.window); give labels of shorter windows, or raise it"
        )
    labels = _row(logged.labels[last], problem)
    known = ~labels.isnan()

    windows = Windows(
        *(_row(part, problem) for part in (logged.states, logged.actions, logged.next_states, logged.step)),
        labels=labels.nan_to_num(0.0),
        labelled=None if bool(known.all()) else known,
        last=_row(last, problem),
        ended=_row(logged.ended, problem),
        terminated=_row(logged.terminated, problem),
    )
    return windows, None if logged.rewards is None else _row(logged.rewards, problem)


def _made(logged: Logged, feedback: Feedback, problem: Problem) -> tuple[Windows, Tensor]:
    """Windows [1, K] that the feedback cuts and labels."""
    if logged.rewards is None:
        raise UserError(f"{logged.source}: it has neither labels nor rewards, from which the feedback could make some")
    rule = copy.deepcopy(feedback)
    rule.delay = rule.delay_windows = 0
    rule.start(problem)
    tape = Playback(logged, problem)
    found = Rolling(tape, rule, problem).collect(tape, len(logged))
    assert found is not None, "every episode ends a window"
    return found


def _even(windows: Windows, primitive: Tensor | None, logged: Logged, problem: Problem) -> Found:
    """The windows [1, K] of T steps, as a grid."""
    length, lengths = problem.window, windows.lengths[0]
    if logged.labels is not None:
        wrong = lengths != length if windows.labelled is None else (lengths != length) | ~windows.labelled[0]
        if wrong.any():
            k = int(wrong.int().argmax())
            raise UserError(
                f"{logged.source}: window {k} has {int(lengths[k])} steps and the label "
                f"{float(logged.labels[int(windows.ends[0, k])]):g}; this run's windows all have {length} steps and a "
                "label: give such ones, or rounds of steps (trainer.steps_per_round)"
            )
    whole = lengths == length
    if not whole.any():
        raise UserError(f"{logged.source}: no window of {length} steps lies in one of its episodes; give longer ones")
    rows = windows.to_steps(whole.unsqueeze(0))[0].bool()
    states, actions, arrivals = (part[:, rows] for part in (windows.states, windows.actions, windows.next_states))
    found = Windows(states, actions, arrivals, labels=windows.labels[:, whole], length=length)
    return found, None if primitive is None else primitive[:, rows]


def _row(values: NDArray[Any], problem: Problem) -> Tensor:
    """What steps or windows have [n, ...] as that of one replica [1, n, ...]."""
    return torch.from_numpy(values.copy()).unsqueeze(0).to(problem.device)


def _repeated(values: Tensor, count: int) -> Tensor:
    """What one replica has [1, …] for each of R."""
    return values.repeat(count, *[1] * (values.dim() - 1))


class Playback(Environment):
    """One copy in which what was logged happens again, and the policy that acts as it was acted then.

    Args:
        logged: steps that fit the problem, with rewards. problem: of one replica.
    """

    copies = 1

    def __init__(self, logged: Logged, problem: Problem) -> None:
        self._problem, self._at = problem, 0

        def column(values: NDArray[Any] | None) -> Sequence[Tensor]:
            """[1, 1, ...] of every step; nothing where nobody says it."""
            return () if values is None else _row(values, problem).movedim(1, 0).unsqueeze(1).unbind()

        self._states, self._actions = column(logged.states), column(logged.actions)
        self._arrivals, self._rewards = column(logged.next_states), column(logged.rewards)
        self._terminated, self._ended = column(logged.terminated), column(logged.ended)
        self._success = column(logged.success)

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        """That of the run."""
        return self._problem

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Back to the first step."""
        self._at = 0

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """The first state of the next episode; behind the last, any."""
        return self._states[self._at % len(self._states)]

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """What was done [1, 1, ...]."""
        return self._actions[self._at]

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """What it led to."""
        at, self._at = self._at, self._at + 1
        over = self._terminated[at]
        facts = {"success": self._success[at]} if self._success else {}
        return Transitions(self._arrivals[at], self._rewards[at], over, self._ended[at] & ~over, facts)

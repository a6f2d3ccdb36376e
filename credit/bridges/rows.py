"""Steps that come one at a time, until they are rows of windows with labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import torch
from torch import Tensor

from credit.core.problem import FLOAT
from credit.core.steps import Steps
from credit.core.windows import Windows


class Row(NamedTuple):
    """One step: encoded state, action and next state, the step in its episode, and where it is kept."""

    state: Tensor
    action: Tensor
    next_state: Tensor
    step: int
    place: int


@dataclass(frozen=True)
class Closed:
    """A window that is over: its rows, its label, whether its episode is over, and whether nothing lies behind."""

    rows: list[Row]
    label: float
    ended: bool
    terminated: bool


def steps_of(rows: Sequence[Row]) -> Steps:
    """Rows side by side [n]."""
    states, actions, next_states = (
        torch.stack([getattr(row, name) for row in rows]) for name in ("state", "action", "next_state")
    )
    return Steps(states, actions, next_states, torch.tensor([row.step for row in rows]))


def windows_of(closed: Sequence[Closed]) -> Windows:
    """Windows of one replica, in the order in which they were closed."""
    steps = steps_of(rows_of(closed))
    last = torch.tensor([len(one.rows) for one in closed]).cumsum(0) - 1
    ended, terminated = torch.zeros(2, 1, len(steps.states), dtype=torch.bool)
    ended[0, last] = torch.tensor([one.ended for one in closed])
    terminated[0, last] = torch.tensor([one.terminated for one in closed])
    assert steps.step is not None
    return Windows(
        steps.states[None],
        steps.actions[None],
        steps.next_states[None],
        steps.step[None],
        labels=torch.tensor([[one.label for one in closed]], dtype=FLOAT),
        last=last[None],
        ended=ended,
        terminated=terminated,
    )


def rows_of(closed: Sequence[Closed]) -> list[Row]:
    """The rows of windows, one after the other."""
    return list(chain.from_iterable(one.rows for one in closed))


def both(one: Steps | None, other: Steps) -> Steps:
    """Steps [n], and more of them behind."""
    if one is None:
        return other
    return Steps(*(torch.cat(pair) for pair in zip(_columns(one), _columns(other), strict=True)))


def chosen(steps: Steps, kept: Tensor) -> Steps:
    """Those of steps [n] that are kept [n]."""
    return Steps(*(column[kept] for column in _columns(steps)))


def _columns(steps: Steps) -> tuple[Tensor, ...]:
    return steps.states, steps.actions, steps.next_states, steps.times

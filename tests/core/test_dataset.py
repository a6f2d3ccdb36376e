"""The growing block of labelled windows."""

from __future__ import annotations

from collections.abc import Callable

import torch

from credit.core.dataset import Dataset
from credit.core.types import Problem, Windows


def test_windows_stay_in_order_while_it_grows(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1))
    pieces = [make_windows(problem, count, seed=count) for count in (1, 4, 2, 30)]
    dataset = Dataset(problem, 2)  # room for two; the rest has to grow
    for piece in pieces:
        dataset.append(piece)
        assert dataset.new is piece
    assert len(dataset) == 37
    for name in ("states", "actions", "next_states", "labels"):
        expected = torch.cat([getattr(piece, name) for piece in pieces], dim=1)
        assert torch.equal(getattr(dataset.windows, name), expected)


def test_it_starts_empty(make_problem: Callable[..., Problem]) -> None:
    dataset = Dataset(make_problem((0, 1)), 0)
    assert len(dataset) == 0
    assert dataset.windows.states.shape == (2, 0, 7)


def test_primitive_rewards_are_kept_only_where_they_were_shown(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem()
    shown = make_windows(problem, 3)
    dataset = Dataset(problem, 3)
    dataset.append(Windows(shown.states, shown.actions, shown.next_states, shown.labels, torch.ones(1, 3, 7)))
    assert torch.equal(dataset.windows.primitive, torch.ones(1, 3, 7))
    hidden = Dataset(problem, 3)
    hidden.append(shown)
    assert hidden.windows.primitive is None

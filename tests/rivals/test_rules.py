"""Equation (29) and its uniform sibling: what is spread sums to the label."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Windows
from credit.rivals.rules import Delayed, Uniform


def windows(labels: list[list[float]], steps: int) -> Windows:
    zeros = torch.zeros(len(labels), len(labels[0]), steps, dtype=torch.int64)
    return Windows.of_grid(zeros, zeros, zeros, torch.tensor(labels, dtype=FLOAT))


def test_delayed_by_hand() -> None:
    assert Delayed().rewards(windows([[3.0, -1.0]], 3)).tolist() == [[0, 0, 3, 0, 0, -1]]


def test_uniform_by_hand() -> None:
    assert Uniform().rewards(windows([[3.0, -1.5]], 3)).tolist() == [[1, 1, 1, -0.5, -0.5, -0.5]]


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_sums_are_the_labels(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows], rule: CreditAssigner
) -> None:
    data = make_windows(make_problem((0, 1)), 11)
    rewards = rule.rewards(data)
    assert rewards.shape == data.states.shape
    torch.testing.assert_close(data.grid(rewards).sum(-1), data.labels)
    assert not rule.learns
    assert rule.belief() is None
    assert rule.table() is None


def test_windows_of_other_lengths_by_hand(make_trajectories: Callable[..., Windows]) -> None:
    # four rows beside six: what is behind the end of a replica is in no window
    found = make_trajectories([[3, 1], [2, 4]], [[6.0, -1.0], [0.0, 1.0]])
    assert Delayed().rewards(found).tolist() == [[0, 0, 6, -1, 0, 0], [0, 0, 0, 0, 0, 1]]
    assert Uniform().rewards(found).tolist() == [[2, 2, 2, -1, 0, 0], [0, 0, 0.25, 0.25, 0.25, 0.25]]


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_sums_over_windows_of_other_lengths_are_the_labels(
    make_trajectories: Callable[..., Windows], rule: CreditAssigner
) -> None:
    found = make_trajectories([[7, 3, 9], [1, 5, 6]], [[0.3, -1.7, 2.0], [1.0, 0.0, 0.1]])
    rewards = rule.rewards(found)
    assert rewards.shape == (2, 19)
    torch.testing.assert_close(found.sums(rewards), found.labels)
    assert (rewards[1, 12:] == 0).all()


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_no_windows_have_no_rewards(rule: CreditAssigner) -> None:
    zeros = torch.zeros(2, 0, 3, dtype=torch.int64)
    assert rule.rewards(Windows.of_grid(zeros, zeros, zeros, torch.zeros(2, 0, dtype=FLOAT))).shape == (2, 0)

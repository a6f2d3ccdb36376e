"""Equation (29) and its uniform sibling: what is spread sums to the label."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.core.interfaces import CreditAssigner
from credit.core.trajectories import Trajectories
from credit.core.types import Problem, Windows
from credit.rivals.rules import Delayed, Uniform


def windows(labels: list[list[float]], steps: int) -> Windows:
    zeros = torch.zeros(len(labels), len(labels[0]), steps, dtype=torch.int64)
    return Windows(zeros, zeros, zeros, torch.tensor(labels, dtype=torch.float64))


def test_delayed_by_hand() -> None:
    assert Delayed().rewards(windows([[3.0, -1.0]], 3)).tolist() == [[[0, 0, 3], [0, 0, -1]]]


def test_uniform_by_hand() -> None:
    assert Uniform().rewards(windows([[3.0, -1.5]], 3)).tolist() == [[[1, 1, 1], [-0.5, -0.5, -0.5]]]


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_sums_are_the_labels(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows], rule: CreditAssigner
) -> None:
    data = make_windows(make_problem((0, 1)), 11)
    rewards = rule.rewards(data)
    assert rewards.shape == data.states.shape
    torch.testing.assert_close(rewards.sum(-1), data.labels)


def test_trajectories_by_hand(make_trajectories: Callable[..., Trajectories]) -> None:
    found = make_trajectories([[3, 1], [2, 4]], [[6.0, -1.0], [0.0, 1.0]])
    assert Delayed().rewards(found).tolist() == [0, 0, 6, -1, 0, 0, 0, 0, 0, 1]
    assert Uniform().rewards(found).tolist() == [2, 2, 2, -1, 0, 0, 0.25, 0.25, 0.25, 0.25]


@pytest.mark.parametrize("rule", [Delayed(), Uniform()])
def test_sums_over_trajectories_are_the_labels(
    make_trajectories: Callable[..., Trajectories], rule: CreditAssigner
) -> None:
    found = make_trajectories([[7, 3, 9], [1, 5, 6]], [[0.3, -1.7, 2.0], [1.0, 0.0, 0.1]])
    rewards = rule.rewards(found)
    assert rewards.shape == (31,)
    torch.testing.assert_close(found.sums(rewards), found.labels)

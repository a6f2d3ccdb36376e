"""Equation (29) and its uniform sibling: what is spread sums to the label."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows
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


def unlabelled(labels: list[list[float]], labelled: list[list[bool]], lengths: list[list[int]]) -> Windows:
    """Windows of some lengths, some of which have no label."""
    rows, many = max(map(sum, lengths)), torch.tensor(lengths)
    zeros = torch.zeros(len(labels), rows, dtype=torch.int64)
    known = torch.tensor(labelled)
    held = torch.where(known, torch.tensor(labels, dtype=FLOAT), 0.0)
    return Windows(zeros, zeros, zeros, labels=held, labelled=known, last=many.cumsum(1) - 1, count=many.sum(1))


ROUNDS = [
    unlabelled(
        [[-2.0, 9.0, -4.0], [9.0, 5.0, 9.0]], [[True, False, True], [False, True, False]], [[2, 2, 2], [1, 3, 2]]
    ),
    unlabelled([[9.0], [9.0]], [[False], [False]], [[2], [2]]),  # a round without a label at all
    unlabelled([[-6.0, 9.0], [9.0, -1.0]], [[True, False], [False, True]], [[2, 1], [2, 1]]),
]


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (
            Delayed(),  # the mean label so far, of each replica: −3, −3, −4 and 5, 5, 2
            [
                [[0, -2, 0, -3, 0, -4], [5, 0, 0, 5, 0, 5]],
                [[0, -3], [0, 5]],
                [[0, -6, -4], [0, 2, -1]],
            ],
        ),
        (
            Uniform(),  # the mean of all labelled steps so far: −6/4, −6/4, −12/6 and 5/3, 5/3, 4/4
            [
                [[-1, -1, -1.5, -1.5, -2, -2], [5 / 3] * 6],
                [[-1.5, -1.5], [5 / 3, 5 / 3]],
                [[-3, -3, -2], [1, 1, -1]],
            ],
        ),
    ],
)
def test_a_window_without_a_label_has_the_mean_of_those_so_far(
    make_problem: Callable[..., Problem], rule: CreditAssigner, expected: list[list[list[float]]]
) -> None:
    """Where rewards are negative, 0 would be the best of all."""
    problem = replace(make_problem((0, 1)), even=False, window=3)
    rule.start(problem)
    store = Store(problem)
    assert not rule.learns
    for windows, rewards in zip(ROUNDS, expected, strict=True):
        store.append(windows)
        rule.observe(store)
        torch.testing.assert_close(rule.rewards(windows), torch.tensor(rewards, dtype=FLOAT))
        state = rule.state_dict()
        rule.start(problem)  # what it has seen is its state
        rule.load_state_dict(state)
        assert rule.learns  # what old windows are given moves with the mean
        torch.testing.assert_close(rule.rewards(store.windows), type(rule)().rewards(store.windows))
    assert not type(rule)().rewards(ROUNDS[1]).any()  # of nothing is known


def test_windows_that_are_not_there_lack_no_label(make_problem: Callable[..., Problem]) -> None:
    """A replica with fewer windows than others is filled up with some of no step."""
    problem = replace(make_problem((0, 1)), even=False, window=3)
    rule, store = Delayed(), Store(problem)
    rule.start(problem)
    store.append(unlabelled([[1.0, 2.0], [3.0, 9.0]], [[True, True], [True, False]], [[2, 2], [3, 0]]))
    rule.observe(store)
    assert not rule.learns

"""What the oracle is shown: a running mean of the primitive reward of every pair."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.core.types import FLOAT, Problem, Windows
from credit.recovery.models.primitive import PrimitiveReward


def shown(states: list[list[int]], actions: list[list[int]], primitive: list[list[float]]) -> Windows:
    """One window of two steps for each of two replicas."""
    s, a, r = torch.tensor(states), torch.tensor(actions), torch.tensor(primitive, dtype=FLOAT)
    return Windows(s.unsqueeze(1), a.unsqueeze(1), s.unsqueeze(1), torch.zeros(2, 1, dtype=FLOAT), r.unsqueeze(1))


@pytest.fixture
def problem(make_problem: Callable[..., Problem]) -> Problem:
    return make_problem((0, 1), states=2, actions=2, window=2)


FIRST = shown([[0, 0], [1, 0]], [[1, 1], [0, 0]], [[1.0, 3.0], [5.0, -1.0]])
SECOND = shown([[0, 1], [1, 1]], [[1, 1], [0, 0]], [[8.0, 7.0], [1.0, 0.0]])
WEIGHTS = torch.ones(2, 1, 4, dtype=FLOAT)


def test_the_mean_by_hand(problem: Problem) -> None:
    model = PrimitiveReward()
    model.start(problem, 3)
    assert (model.estimate().mean == 0).all()
    model.observe(FIRST, WEIGHTS)  # replica 0 sees pair 1 twice in one window
    assert model.estimate().mean.tolist() == [[0, 2, 0, 0], [-1, 0, 5, 0]]
    model.observe(SECOND, WEIGHTS)
    assert model.estimate().mean.tolist() == [[0, 4, 0, 7], [-1, 0, 2, 0]]
    draws = model.estimate().draws
    assert draws.shape == (2, 3, 4)
    assert (draws == model.estimate().mean.unsqueeze(1)).all()  # nothing is uncertain


def test_refit_and_start_forget(problem: Problem) -> None:
    model = PrimitiveReward()
    model.start(problem, 3)
    model.observe(FIRST, WEIGHTS)
    model.refit(SECOND, WEIGHTS)
    assert model.estimate().mean.tolist() == [[0, 8, 0, 7], [0, 0, 0.5, 0]]
    model.start(problem, 3)
    assert (model.estimate().mean == 0).all()


def test_an_estimate_is_not_changed_by_later_windows(problem: Problem) -> None:
    model = PrimitiveReward()
    model.start(problem, 0)
    model.observe(FIRST, WEIGHTS[..., :1])
    before = model.estimate().mean
    model.observe(SECOND, WEIGHTS[..., :1])
    assert before.tolist() == [[0, 2, 0, 0], [-1, 0, 5, 0]]


def test_it_says_when_nothing_is_shown(problem: Problem) -> None:
    model = PrimitiveReward()
    model.start(problem, 0)
    hidden = Windows(FIRST.states, FIRST.actions, FIRST.next_states, FIRST.labels)
    with pytest.raises(ValueError, match="primitive reward was not shown"):
        model.observe(hidden, WEIGHTS[..., :1])

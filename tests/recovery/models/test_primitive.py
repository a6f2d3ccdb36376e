"""What the oracle is shown: a running mean of the primitive reward of every cell, or the reward of every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from credit.core.problem import FLOAT, Problem
from credit.core.steps import Steps
from credit.core.store import Windows
from credit.recovery.models.primitive import PrimitiveReward

from ..fits import Experience, Given, part

MakeRagged = Callable[..., Windows]


def shown(states: list[list[int]], actions: list[list[int]], primitive: list[list[float]]) -> Windows:
    """One window of two steps for each of two replicas."""
    s, a, r = torch.tensor(states), torch.tensor(actions), torch.tensor(primitive, dtype=FLOAT)
    return Windows(s, a, s, labels=torch.zeros(2, 1, dtype=FLOAT), length=2, primitive=r)


@pytest.fixture
def problem(make_problem: Callable[..., Problem]) -> Problem:
    return make_problem((0, 1), states=2, actions=2, window=2)


FIRST = shown([[0, 0], [1, 0]], [[1, 1], [0, 0]], [[1.0, 3.0], [5.0, -1.0]])
SECOND = shown([[0, 1], [1, 1]], [[1, 1], [0, 0]], [[8.0, 7.0], [1.0, 0.0]])


def test_the_mean_by_hand(problem: Problem) -> None:
    model = PrimitiveReward(uncertainty=Given(3))
    assert model.sees_primitive
    experience = Experience(problem, model)
    assert (model.estimate().mean == 0).all()
    experience.see(FIRST)  # replica 0 sees pair 1 twice in one window
    assert model.estimate().mean.tolist() == [[0, 2, 0, 0], [-1, 0, 5, 0]]
    experience.see(SECOND)
    found = model.estimate()
    assert found.mean.tolist() == [[0, 4, 0, 7], [-1, 0, 2, 0]]
    assert found.draws is not None
    assert found.draws.shape == (2, 3, 4)
    assert (found.draws == found.mean.unsqueeze(1)).all()  # nothing is uncertain
    assert (found.variance == 0).all()
    assert model.estimate(torch.tensor([[1, 1, 3], [2, 0, 1]])).mean.tolist() == [[4, 4, 7], [2, -1, 0]]


def test_start_forgets(problem: Problem) -> None:
    model = PrimitiveReward()
    Experience(problem, model).see(FIRST)
    Experience(problem, model).see(SECOND)
    assert model.estimate().mean.tolist() == [[0, 8, 0, 7], [0, 0, 0.5, 0]]
    assert model.estimate().draws is None


def test_an_estimate_is_not_changed_by_later_windows(problem: Problem) -> None:
    model = PrimitiveReward()
    experience = Experience(problem, model).see(FIRST)
    before = model.estimate().mean
    experience.see(SECOND)
    assert before.tolist() == [[0, 2, 0, 0], [-1, 0, 5, 0]]


def test_it_says_when_nothing_is_shown(problem: Problem) -> None:
    with pytest.raises(ValueError, match="primitive reward was not shown"):
        Experience(problem, PrimitiveReward()).see(replace(FIRST, primitive=None))


def test_a_round_without_windows_changes_nothing(problem: Problem) -> None:
    model = PrimitiveReward()
    experience, none = Experience(problem, model), replace(part(FIRST, slice(0)), primitive=torch.zeros(2, 0).double())
    assert (experience.see(none).models[0].estimate().mean == 0).all()
    experience.see(FIRST).see(none)
    assert model.estimate().mean.tolist() == [[0, 2, 0, 0], [-1, 0, 5, 0]]


def test_steps_have_the_reward_that_was_shown(
    make_continuous: Callable[..., Problem], make_trajectories: MakeRagged
) -> None:
    model = PrimitiveReward()
    experience = Experience(make_continuous((3, 4)), model)
    pieces = [
        make_trajectories([[3, 1], [2, 4]], [[1.0, 0.0], [0.0, 1.0]]),
        make_trajectories([[7], [2]], [[1.0], [0.0]]),
    ]
    shown = [torch.arange(12.0).view(2, 6), torch.arange(20.0, 34.0).view(2, 7)]
    for piece, rewards in zip(pieces, shown, strict=True):
        experience.see(replace(piece, primitive=rewards.double()))
    found = model.estimate()
    assert found.mean[0, :11].tolist() == [0, 1, 2, 3, 20, 21, 22, 23, 24, 25, 26]
    assert found.mean[1, :8].tolist() == [6, 7, 8, 9, 10, 11, 27, 28]
    assert torch.equal(found.variance, torch.zeros_like(found.mean))
    states = pieces[0].states[0, :3]
    elsewhere = model.believe(Steps(states, pieces[0].actions[0, :3], states))
    assert elsewhere.mean.shape == (2, 3)
    assert elsewhere.mean.isnan().all()
    assert torch.equal(elsewhere.variance, torch.zeros(2, 3, dtype=FLOAT))

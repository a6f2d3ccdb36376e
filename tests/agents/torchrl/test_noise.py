"""What exploration draws: alone as in a batch, and after an interruption as without one."""

from __future__ import annotations

from typing import Literal

import pytest
import torch

from credit.agents.torchrl.noise import PART, Noise
from credit.core.problem import Problem


def problem(*seeds: int) -> Problem:
    return Problem.vectors(2, 2, 9, seeds)


def at(step: int, replicas: int, copies: int = 2) -> torch.Tensor:
    return torch.full((replicas, copies), step)


def test_other_replicas_make_no_difference_however_long_their_episodes_last() -> None:
    both, alone = Noise(problem(3, 4), "a", "normal", 2), Noise(problem(4), "a", "normal", 2)
    for length, longest in ((3, 8), (5, 5), (2, 7)):  # of the second replica, and of the batch
        mine, all_ = ([noise(at(t, r)) for t in range(n)] for noise, r, n in ((alone, 1, length), (both, 2, longest)))
        for one, several in zip(mine, all_[:length], strict=True):
            assert torch.equal(one[0], several[1])
            assert not torch.equal(several[0], several[1])


def test_copies_may_begin_at_different_times() -> None:
    noise, other = (Noise(problem(3), "a", "normal", 1) for _ in range(2))
    together = torch.stack([noise(at(t, 1)) for t in range(4)])
    late = [other(torch.tensor([[t, t - 1 if t else 7]])) for t in range(5)]
    assert torch.equal(torch.stack(late[:4])[:, 0, 0], together[:, 0, 0])
    # the second copy began with an episode that it was not asked to begin
    assert torch.equal(torch.stack(late[1:])[:, 0, 1], together[:, 0, 1])


@pytest.mark.parametrize("before", [1, PART, PART + 3])
def test_it_goes_on_in_the_middle_of_an_episode(before: int) -> None:
    one, other = (Noise(problem(3, 4), "a", "uniform", 2) for _ in range(2))
    for step in range(before):
        one(at(step, 2))
    other.load_state_dict(one.state_dict())
    for step in range(before, before + PART):
        assert torch.equal(one(at(step, 2)), other(at(step, 2)))
    assert torch.equal(one(at(0, 2)), other(at(0, 2)))


@pytest.mark.parametrize(("kind", "mean", "variance"), [("uniform", 0.5, 1 / 12), ("normal", 0.0, 1.0)])
def test_the_law(kind: Literal["uniform", "normal"], mean: float, variance: float) -> None:
    noise = Noise(problem(*range(20)), "a", kind, 3)
    drawn = torch.stack([noise(at(t, 20)) for t in range(2 * PART)]).double()
    count = drawn.numel() ** 0.5
    assert abs(float(drawn.mean()) - mean) < 5 * variance**0.5 / count
    assert abs(float(drawn.var()) - variance) < 5 * variance * 2**0.5 / count
    assert len(drawn.unique()) > 0.999 * drawn.numel()

"""Facts of DeepSea: where moves lead, what they cost, and what the best of all policies gets."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import torch

from credit.envs.deepsea.environment import DeepSea
from credit.envs.feedback import BlockSum

from ..collecting import collected


def test_moves_by_hand() -> None:
    sea = DeepSea(3)
    cost = 0.01 / 3
    assert sea.outcomes(0, 0) == [(1.0, 3, 0.0)]  # the wall holds
    assert sea.outcomes(0, 1)[0] == (1.0, 4, pytest.approx(-cost))
    assert sea.outcomes(4, 0) == [(1.0, 6, 0.0)]
    assert sea.outcomes(4, 1)[0] == (1.0, 8, pytest.approx(-cost))
    assert sea.outcomes(8, 1)[0] == (1.0, 9, pytest.approx(1 - cost))  # the treasure
    assert sea.outcomes(8, 0) == [(1.0, 9, 0.0)]
    assert sea.outcomes(9, 1) == []  # the ground
    assert sea.deviation(8, 1) == 0


def test_moves_of_a_windy_sea_by_hand() -> None:
    sea = DeepSea(4, windy=True)
    assert sea.outcomes(0, 1) == [(0.75, 5, pytest.approx(-0.0025)), (0.25, 4, pytest.approx(-0.0025))]
    assert [s for s in range(17) if sea.deviation(s, 0)] == [12, 15]


@pytest.mark.parametrize("size", [1, 2, 5, 10, 30])
def test_the_best_return(size: int) -> None:
    truth = DeepSea(size).truth("sum", size)
    assert truth is not None
    assert truth.best == pytest.approx(0.99)
    assert truth.random == pytest.approx(0.5**size - 0.005)  # half of all steps cost .01/N, and one way of 2^N pays


def test_of_all_ways_one_is_good() -> None:
    returns = {}
    for way in product((0, 1), repeat=4):
        sea, state, total = DeepSea(4), 0, 0.0
        for action in way:
            _, state, reward = sea.outcomes(state, action)[0]
            total += reward
        returns[way] = total
    assert returns.pop((1, 1, 1, 1)) == pytest.approx(0.99)
    assert max(returns.values()) == 0


def test_in_the_wind_the_best_return_is_about_that_of_bsuite() -> None:
    truth = DeepSea(10, windy=True).truth("sum", 10)
    assert truth is not None
    reached = 0.9**9
    assert reached - 0.01 < truth.best < reached  # who was blown off the way saves the cost of the rest


def test_a_mapping_turns_actions_around_cell_by_cell() -> None:
    plain, mapped = DeepSea(6), DeepSea(6, mapping=3)
    assert 0 < mapped.right.mean() < 1
    assert np.array_equal(mapped.right, DeepSea(6, mapping=3).right)
    assert not np.array_equal(mapped.right, DeepSea(6, mapping=4).right)
    for state in range(36):
        right = mapped.right[divmod(state, 6)]
        assert mapped.outcomes(state, int(right)) == plain.outcomes(state, 1)
        assert mapped.outcomes(state, int(1 - right)) == plain.outcomes(state, 0)
    truth = mapped.truth("sum", 6)
    assert truth is not None
    assert truth.best == pytest.approx(0.99)


def test_a_dive() -> None:
    windows, primitive = collected(DeepSea(5), BlockSum(5, 0.0), (0,), lambda s, _: torch.ones_like(s), 2)
    assert windows.states[0].tolist() == [0, 6, 12, 18, 24] * 2
    torch.testing.assert_close(primitive[0, 0], torch.tensor([-0.002] * 4 + [0.998], dtype=torch.float64))
    torch.testing.assert_close(windows.labels, torch.full((1, 2), 0.99, dtype=torch.float64))

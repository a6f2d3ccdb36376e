"""Facts of the umbrella chain: the first action decides, the last step pays, all else is noise."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.envs.feedback import BlockSum
from credit.envs.umbrella.environment import Umbrella

from ..collecting import collected


@pytest.mark.parametrize(("horizon", "distractors"), [(1, 0), (2, 3), (20, 2), (100, 0)])
def test_the_best_return_is_1_and_that_of_chance_0(horizon: int, distractors: int) -> None:
    env = Umbrella(horizon, distractors)
    assert env.sizes == ((horizon + 1) * 4 * 2**distractors, 2)
    truth = env.truth("sum", horizon)
    assert truth is not None
    assert truth.best == pytest.approx(1)
    assert truth.random == pytest.approx(0, abs=1e-9)
    never = torch.zeros(1, horizon, env.sizes[0], dtype=torch.int64)
    assert float(truth.evaluate(never)) == pytest.approx(0, abs=1e-9)


def test_outcomes_by_hand() -> None:
    env = Umbrella(3, 1)

    def at(*digits: int) -> int:
        return int(np.ravel_multi_index(digits, env.digits))

    taken = env.outcomes(at(0, 1, 0, 1), 1)
    assert sorted(taken) == sorted([(0.25, at(1, 1, 1, bit), reward) for bit in (0, 1) for reward in (1.0, -1.0)])
    assert sorted(env.outcomes(at(1, 1, 1, 0), 0)) == sorted(
        [(0.25, at(2, 1, 1, bit), reward) for bit in (0, 1) for reward in (1.0, -1.0)]
    )
    assert env.outcomes(at(2, 1, 1, 0), 0) == [(0.5, at(3, 1, 1, 0), 1.0), (0.5, at(3, 1, 1, 1), 1.0)]
    assert {reward for *_, reward in env.outcomes(at(2, 0, 1, 0), 1)} == {-1.0}
    assert env.outcomes(at(3, 1, 1, 0), 0) == []


def test_without_noise_the_label_is_the_end() -> None:
    env = Umbrella(5, 2, noise=0.0)

    def right(states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        return states // 8 % 2  # what is needed

    windows, primitive = collected(env, BlockSum(5, 0.0), (0, 1), right, 20)
    assert torch.equal(windows.labels, torch.ones_like(windows.labels))
    assert torch.equal(primitive[..., :-1], torch.zeros_like(primitive[..., :-1]))
    wrong, _ = collected(env, BlockSum(5, 0.0), (0,), lambda s, t: 1 - right(s, t), 20)
    assert torch.equal(wrong.labels, -torch.ones_like(wrong.labels))


def test_the_noise_of_a_label_is_that_of_its_coins() -> None:
    windows, _ = collected(Umbrella(10, 0), BlockSum(10, 0.0), (0,), lambda s, t: s // 2 % 2, 500)
    assert float(windows.labels.mean()) == pytest.approx(1, abs=5 * 3 / 500**0.5)
    assert float(windows.labels.var()) == pytest.approx(9, rel=0.25)


def test_more_distractors_than_tables_hold_are_refused() -> None:
    with pytest.raises(UserError, match="distractors"):
        Umbrella(20, 20)

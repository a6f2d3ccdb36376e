"""Facts of watch repair: what a repair of each brand is worth, and when it is paid."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from credit.core.problem import FLOAT
from credit.envs.feedback import BlockSum
from credit.envs.watch_repair.environment import WatchRepair

from ..collecting import begun, collected

WORTH = (-1.5, 3.5, 3.5, -1.5)  # 18 − 1 − .5 − 18, 28 − 4 − 2.5 − 18, 31 − 5 − 4.5 − 18, 59 − 24.5 − 18 − 18


def state(env: WatchRepair, *digits: int) -> int:
    return int(np.ravel_multi_index(digits, env.digits))


def test_the_better_choices_are_worth_what_was_published() -> None:
    env = WatchRepair()
    truth = env.truth("sum", 50)
    assert truth is not None
    assert truth.best == pytest.approx(7 / 4)
    assert truth.random == pytest.approx(sum(WORTH) / 8)
    for brand, worth in enumerate(WORTH):
        policy = torch.ones(1, 50, env.sizes[0], dtype=torch.int64)
        policy[:, 0, brand] = 0
        assert float(truth.evaluate(policy)) == pytest.approx(worth / 4)
    best = torch.ones(1, 50, env.sizes[0], dtype=torch.int64)
    best[:, 0, 1:3] = 0
    assert float(truth.evaluate(best)) == pytest.approx(truth.best)


def test_outcomes_by_hand() -> None:
    env = WatchRepair()
    both = env.outcomes(state(env, 0, 0, 0, 0, 1), 0)
    assert [probability for probability, _, _ in both] == pytest.approx([0.9 * 0.95, 0.9 * 0.05, 0.1 * 0.95, 0.005])
    assert [then for _, then, _ in both] == [state(env, 1, 1, jam, flat, 1) for jam in (0, 1) for flat in (0, 1)]
    assert [reward for *_, reward in both] == pytest.approx([-4, -11, -4.1, -11.1])
    left = env.outcomes(state(env, 0, 0, 0, 0, 1), 1)
    assert [then for _, then, _ in left] == [state(env, 1, 0, jam, flat, 1) for jam in (0, 1) for flat in (0, 1)]
    assert all(reward == 0 for *_, reward in left)
    sold = env.outcomes(state(env, 49, 1, 1, 0, 3), 1)
    assert [reward for *_, reward in sold] == pytest.approx([41, 34, 40.9, 33.9])
    assert env.outcomes(state(env, 20, 1, 0, 0, 2), 0) == env.outcomes(state(env, 20, 1, 1, 1, 2), 1)  # nothing to do


def test_noise_is_of_the_costs_alone() -> None:
    env = WatchRepair()
    assert env.deviation(state(env, 0, 0, 0, 0, 3), 0) == 1
    assert env.deviation(state(env, 0, 0, 0, 0, 0), 0) == 2
    assert env.deviation(state(env, 0, 0, 0, 0, 0), 1) == 0
    assert env.deviation(state(env, 49, 1, 0, 0, 0), 1) == 1.5
    assert env.deviation(state(env, 49, 0, 0, 0, 0), 0) == 0
    assert env.deviation(state(env, 30, 1, 1, 1, 0), 0) == 0


def test_labels_have_the_law_of_the_demonstration() -> None:
    """All costs at once, drawn anew: 50 times each event, as its authors have it, by NumPy."""
    random, count = np.random.default_rng(0), 4000
    delivery = random.binomial(50, 0.1, count) * 0.1 + random.binomial(50, 0.05, count) * 7
    theirs = 28 - random.normal(4, 2, count) - random.normal(2.5, 1.5, count) - delivery
    env = WatchRepair()
    windows, _ = collected(env, BlockSum(50, 0.0), (0,), lambda s, t: torch.zeros_like(s), 400)
    ours = windows.labels[windows.states.view(1, -1, 50)[..., 0] == 1].numpy()
    assert len(ours) > 70
    error = theirs.std() / len(ours) ** 0.5
    assert abs(ours.mean() - 3.5) < 4 * error
    assert abs(ours.mean() - theirs.mean()) < 5 * error
    assert ours.std() == pytest.approx(theirs.std(), rel=0.2)


def test_only_the_first_action_counts() -> None:
    env = WatchRepair(6)
    _, problem = begun(env, BlockSum(6, 0.0))
    assert problem.states == 7 * 32
    truth = env.truth("sum", 6)
    assert truth is not None
    some = torch.full((1, 6, *env.sizes), 0.5, dtype=FLOAT)
    some[:, 0, :, 0], some[:, 0, :, 1] = 0.25, 0.75
    other = some.clone()
    other[:, 1:, :, 0], other[:, 1:, :, 1] = 0.9, 0.1
    assert float(truth.evaluate(some)) == pytest.approx(float(truth.evaluate(other)))

"""The second implementation is checked on its own: by hand, not against the first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from credit.bench import naive


def test_features_by_hand() -> None:
    states, actions = np.array([[0, 5]]), np.array([[2, 1]])
    assert naive.identity(states, actions).argmax(-1).tolist() == [[2, 16]]
    assert naive.bilinear(states, actions).tolist() == [[[1, 0, 2, 0], [1, 5, 1, 5]]]
    assert naive.threshold(states, actions).argmax(-1).tolist() == [[2, 4]]


def test_fit_by_hand() -> None:
    # One window visits (0, 0) twice, Y = 3, λ = .1: θ = 2·3/(4 + .1)
    table = naive.fit(naive.identity, np.array([[0, 0]]), np.array([[0, 0]]), np.array([3.0]))
    assert table.shape == (10, 3)
    assert table[0, 0] == pytest.approx(6 / 4.1)
    assert abs(table).sum() == pytest.approx(6 / 4.1)


def test_weights_by_hand() -> None:
    # δ = (1.5, 0, .5), α = .5: exponents (−3, 0, −1)
    found = naive.weights({"a": np.array([0.04]), "b": np.array([0.01]), "c": np.array([0.02])})
    total = 1 + math.exp(-3) + math.exp(-1)
    assert [float(found[name][0]) for name in "abc"] == pytest.approx(
        [math.exp(-3) / total, 1 / total, math.exp(-1) / total]
    )


def test_proxies_keep_to_their_definitions() -> None:
    rng = np.random.default_rng(0)
    states, actions, labels = rng.integers(10, size=(50, 7)), rng.integers(3, size=(50, 7)), rng.normal(size=50)
    both = [naive.proxies(states, actions, labels, 6, np.random.default_rng(3), cache=cache) for cache in (False, True)]
    for first, second in zip(*both, strict=True):
        for name in first:
            np.testing.assert_allclose(first[name], second[name], atol=1e-10)
    _, mse, gaps = both[0]
    assert set(gaps) == {"linear", "threshold"}
    for name in gaps:
        assert (mse[name] >= gaps[name]).all()


def test_plan_by_hand() -> None:
    # A line where action 0 goes down, 1 stays and 2 goes up, and only staying in state 7 pays
    transition = np.zeros((10, 3, 10))
    for action, move in enumerate((-1, 0, 1)):
        transition[np.arange(10), action, np.clip(np.arange(10) + move, 0, 9)] = 0.9
        transition[np.arange(10), action, np.arange(10)] += 0.1
    reward = np.zeros((10, 3))
    reward[7, 1] = 1
    # from this start no policy on the way has two recurrent classes
    start = np.array([2, 2, 2, 2, 2, 2, 2, 2, 0, 0])
    assert naive.plan(transition, reward, start).tolist() == [2, 2, 2, 2, 2, 2, 2, 1, 0, 0]


def test_decide_gives_a_policy_and_remembers_it() -> None:
    rng = np.random.default_rng(1)
    learner = naive.NaiveDisagreement(np.random.default_rng(2), draws=4)
    states, actions = rng.integers(10, size=(30, 7)), rng.integers(3, size=(30, 7))
    arrivals = np.clip(states + rng.integers(-1, 2, size=(30, 7)), 0, 9)
    policy = learner.decide(states, actions, arrivals, rng.normal(size=30))
    assert policy.shape == (10,)
    assert set(policy.tolist()) <= {0, 1, 2}
    assert learner.policy is policy

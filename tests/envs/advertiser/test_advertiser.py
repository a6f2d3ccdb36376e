"""Facts of the toy advertiser of section 6.1, and that every parameter does what it says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from credit.core.errors import UserError
from credit.envs.advertiser.environment import Advertiser
from credit.planning.solve import policy_iteration, stationary


def gain_of(advertiser: Advertiser, policy: list[int]) -> float:
    """Long-run profit a step of a policy."""
    mdp = advertiser.mdp
    chosen = torch.tensor(policy)
    return float((stationary(mdp.transition, chosen) * mdp.reward.gather(1, chosen[:, None])[:, 0]).sum())


def test_optimal_gain_and_policy() -> None:
    optimal = Advertiser().mdp.optimal
    assert float(optimal.gain) == pytest.approx(0.037222, abs=5e-7)
    assert optimal.policy.tolist() == [1, 2, 2, 2, 2, 2, 1, 1, 1, 1]


def test_low_states_are_left_for_good() -> None:
    occupancy = Advertiser().mdp.occupancy
    assert occupancy[:5].abs().max() < 1e-12
    assert float(occupancy.sum()) == pytest.approx(1)
    assert (occupancy[5:] > 0.01).all()


def test_the_smallest_action_gap() -> None:
    values = Advertiser().mdp.optimal.values.sort(-1).values
    gaps = values[:, -1] - values[:, -2]
    assert int(gaps.argmin()) == 5
    assert float(gaps.min()) == pytest.approx(0.0097, abs=5e-5)


def test_random_actions_lose() -> None:
    # a one-action problem whose action is chosen uniformly
    mdp = Advertiser().mdp
    plan = policy_iteration(mdp.transition.mean(1)[None, :, None], mdp.reward.mean(1)[None, :, None])
    assert float(plan.gain) == pytest.approx(-0.0625, abs=5e-5)


def test_never_advertising_is_the_trap() -> None:
    assert gain_of(Advertiser(), [0] * 10) == pytest.approx(0)  # regret 14,000 · .037222 = 521
    assert gain_of(Advertiser(), Advertiser().mdp.optimal.policy.tolist()) == pytest.approx(0.037222, abs=5e-7)


@pytest.mark.parametrize(
    ("state", "action", "expected"),
    [
        (0, 0, 0.0),
        (0, 2, -0.1 - 0.48),  # −.05·2 − .12·4
        (4, 1, 0.2 - 0.08 - 0.05 - 0.12 + 0.08),  # .05·4 − .005·16 − .05 − .12 + .02·4
        (5, 2, 0.25 - 0.125 - 0.1 - 0.48 + 0.25),
        (9, 0, 0.45 - 0.405),
        (9, 2, 0.45 - 0.405 - 0.1 - 0.48 + 0.45),
    ],
)
def test_reward_by_hand(state: int, action: int, expected: float) -> None:
    assert float(Advertiser().mdp.reward[state, action]) == pytest.approx(expected, abs=1e-12)


def test_transition_rows_by_hand() -> None:
    p = Advertiser().mdp.transition
    assert p.shape == (10, 3, 10)

    def row(s: int, a: int) -> dict[int, float]:
        return {int(i): pytest.approx(float(p[s, a, i])) for i in p[s, a].nonzero()}

    assert row(4, 0) == {3: 0.6, 4: 0.4}
    assert row(4, 1) == {3: 0.3, 4: 0.4, 5: 0.3}
    assert row(4, 2) == {4: 0.4, 5: 0.6}
    assert row(0, 0) == {0: 1.0}  # reflecting: a move off the scale stays
    assert row(0, 1) == {0: 0.7, 1: 0.3}
    assert row(9, 2) == {9: 1.0}
    assert row(9, 1) == {8: 0.3, 9: 0.7}


BASE = Advertiser().mdp


@pytest.mark.parametrize(
    ("parameters", "change"),
    [
        ({"gain": 0.06}, lambda s, a: 0.01 * s),
        ({"crowding": 0.006}, lambda s, a: -0.001 * s**2),
        ({"cost": 0.07}, lambda s, a: -0.02 * a),
        ({"convexity": 0.1}, lambda s, a: 0.02 * a**2),
        ({"interaction": (0.0, 0.05, 0.05)}, lambda s, a: 0.03 * s * (a == 1)),
    ],
)
def test_reward_parameters(parameters: dict[str, Any], change: Callable[[int, int], float]) -> None:
    mdp = Advertiser(**parameters).mdp
    expected = torch.tensor([[change(s, a) for a in range(3)] for s in range(10)], dtype=torch.float64)
    torch.testing.assert_close(mdp.reward - BASE.reward, expected)
    assert torch.equal(mdp.transition, BASE.transition)


@pytest.mark.parametrize(
    ("parameters", "action", "row"),
    [
        ({"p_down": 0.1}, 0, [0.1, 0.9, 0.0]),
        ({"p_mid_down": 0.1}, 1, [0.1, 0.6, 0.3]),
        ({"p_mid_up": 0.7}, 1, [0.3, 0.0, 0.7]),
        ({"p_up": 1.0}, 2, [0.0, 0.0, 1.0]),
    ],
)
def test_move_parameters(parameters: dict[str, Any], action: int, row: list[float]) -> None:
    mdp = Advertiser(**parameters).mdp
    assert mdp.transition[4, action, 3:6].tolist() == pytest.approx(row)
    others = [a for a in range(3) if a != action]
    assert torch.equal(mdp.transition[:, others], BASE.transition[:, others])
    assert torch.equal(mdp.reward, BASE.reward)


def test_sizes_and_start() -> None:
    mdp = Advertiser(states=4, interaction=(0.0, 0.1, 0.2, 0.3), initial_state=2).mdp
    assert mdp.transition.shape == (4, 4, 4)
    assert mdp.initial.tolist() == [0, 0, 1, 0]
    assert torch.equal(mdp.transition[:, 1], mdp.transition[:, 2])  # both actions between are mixed moves
    assert mdp.transition[1, 3].tolist() == pytest.approx([0, 0.4, 0.6, 0])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"states": 1}, r"env\.states=1"),
        ({"interaction": (0.5,)}, r"env\.interaction=\[0\.5\].*at least 2"),
        ({"p_mid_down": 0.7, "p_mid_up": 0.4}, r"p_mid_down.*p_mid_up.*1\.1.*at most 1"),
        ({"initial_state": 10}, r"env\.initial_state=10.*0 to 9"),
        ({"initial_state": -1}, r"env\.initial_state=-1.*0 to 9"),
    ],
)
def test_invalid_parameters(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Advertiser(**parameters)


@pytest.mark.parametrize(
    "parameters",
    [
        {"interaction": (0.0, 1.0)},  # no action between: the best is to advertise always
        {"interaction": (0.0, 0.02, 0.2)},
    ],
)
def test_advertising_always_is_best_where_it_pays(parameters: dict[str, Any]) -> None:
    # At the top the last action stays for ever, so its profit there is the gain of advertising always.
    advertiser = Advertiser(**parameters)
    reward = advertiser.mdp.reward
    assert reward[9, -1] == reward.max()
    assert float(advertiser.mdp.optimal.gain) == pytest.approx(float(reward[9, -1]))


@given(st.floats(-0.1, 0.1), st.floats(-0.01, 0.01), st.floats(0, 0.2), st.floats(0, 0.1), st.floats(0, 0.2))
def test_the_optimum_solves_its_equation_for_any_reward(
    gain: float, crowding: float, cost: float, middle: float, high: float
) -> None:
    mdp = Advertiser(gain=gain, crowding=crowding, cost=cost, interaction=(0.0, middle, high)).mdp
    ahead = mdp.reward + mdp.transition @ mdp.optimal.bias
    torch.testing.assert_close(mdp.optimal.gain + mdp.optimal.bias, ahead.amax(-1), atol=1e-5, rtol=0)


def test_advertising_that_costs_little() -> None:
    # r(9, 2) = .45 − .405 − 0 − .04 + .45 = .455 a step at the top, which action 2 never leaves
    advertiser = Advertiser(cost=0.0, convexity=0.01)
    assert float(advertiser.mdp.optimal.gain) == pytest.approx(gain_of(advertiser, [2] * 10))

"""Dynamic programming against chains that can be solved by hand, against the Bellman equation (42), against NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from credit.bench import naive
from credit.envs.advertiser.environment import Advertiser
from credit.planning.solve import NEARLY_ONE, diameter, first_best, policy_iteration, stationary


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def random_mdp(seed: int, replicas: int = 1, states: int = 6, actions: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    transition = rng.dirichlet(np.ones(states), size=(replicas, states, actions))
    return torch.from_numpy(transition), torch.from_numpy(rng.normal(size=(replicas, states, actions)))


def test_gain_and_bias_of_a_chain_by_hand() -> None:
    # Stationary distribution (1/3, 2/3), so g = 3/3 = 1. With h(0) = 0: 1 = 3 + .5·h(1), h(1) = −4.
    plan = policy_iteration(tensor([[[[0.5, 0.5]], [[0.25, 0.75]]]]), tensor([[[3.0], [0.0]]]))
    torch.testing.assert_close(plan.gain, tensor([1.0]))
    torch.testing.assert_close(plan.bias, tensor([[0.0, -4.0]]))
    torch.testing.assert_close(plan.values, tensor([[[0.0], [-4.0]]]))


def test_a_decision_by_hand() -> None:
    # State 0: wait (r = 1, stay) or cross (r = 0, to state 1); state 1 pays 4 and falls back with probability 1/2.
    # Crossing: stationary (1/3, 2/3), gain 8/3 > 1. h(0) = 0: 8/3 = 0 + h(1).
    transition = tensor([[[[1, 0], [0, 1]], [[0.5, 0.5], [0.5, 0.5]]]])
    plan = policy_iteration(transition, tensor([[[1, 0], [4, 4]]]))
    assert plan.policy.tolist() == [[1, 0]]
    torch.testing.assert_close(plan.gain, tensor([8 / 3]))
    torch.testing.assert_close(plan.bias, tensor([[0, 8 / 3]]))


@given(st.integers(0, 10_000))
def test_the_bellman_equation_holds(seed: int) -> None:
    transition, reward = random_mdp(seed)
    plan = policy_iteration(transition, reward)
    # (42): g + h(s) = max_a [r(s, a) + Σ P(s'|s, a) h(s')]
    ahead = reward + torch.einsum("rsan,rn->rsa", transition, plan.bias)
    torch.testing.assert_close(plan.gain[:, None] + plan.bias, ahead.amax(-1), atol=1e-9, rtol=0)
    torch.testing.assert_close(plan.values, ahead - plan.gain[:, None, None], atol=1e-9, rtol=0)
    assert (plan.bias[:, 0] == 0).all()
    occupied = stationary(transition[0], plan.policy[0])
    torch.testing.assert_close((occupied * reward[0].gather(1, plan.policy[0][:, None])[:, 0]).sum(), plan.gain[0])


@given(st.integers(0, 10_000), st.sampled_from([0.3, 0.9, 0.99]), st.booleans())
def test_discounted_values_equal_numpy_value_iteration(seed: int, discount: float, leaky: bool) -> None:
    transition, reward = random_mdp(seed)
    if leaky:  # rows may sum to less than one, or to nothing: the process then ends
        transition = transition * torch.rand(
            6, 3, 1, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)
        )
        transition[0, 2] = 0
    plan = policy_iteration(transition, reward, discount)
    p, r, value = transition[0].numpy(), reward[0].numpy(), np.zeros(6)
    for _ in range(4000):
        value = (r + discount * p @ value).max(1)
    expected = r + discount * p @ value
    np.testing.assert_allclose(plan.bias[0] + plan.gain[0] / (1 - discount), value, atol=1e-9)
    chosen = np.take_along_axis(expected, plan.policy[0].numpy()[:, None], 1)[:, 0]
    np.testing.assert_allclose(chosen, value, atol=1e-8)


def test_rows_of_zero_end_the_process_by_hand() -> None:
    # State 0 pays 5 and ends; state 1 pays 1 and moves to 0: v = (5, 1 + γ·5)
    plan = policy_iteration(tensor([[[[0, 0]], [[1, 0]]]]), tensor([[[5], [1]]]), 0.9)
    torch.testing.assert_close(plan.gain / 0.1, tensor([5.0]))
    torch.testing.assert_close(plan.bias + plan.gain / 0.1, tensor([[5.0, 5.5]]))


def test_several_recurrent_classes() -> None:
    # Two islands, each a state where one can stay (r = 1 or 2) or cross (r = 0). v(1) = 2/(1 − γ), v(0) = γ·v(1).
    transition = tensor([[[[1, 0], [0, 1]], [[0, 1], [1, 0]]]])
    plan = policy_iteration(transition, tensor([[[1, 0], [2, 0]]]), NEARLY_ONE)
    assert plan.policy.tolist() == [[1, 0]]
    torch.testing.assert_close(plan.gain, tensor([2 * NEARLY_ONE]))
    torch.testing.assert_close(plan.bias, tensor([[0.0, 2.0]]), atol=1e-8, rtol=0)


def test_islands_that_cannot_be_left() -> None:
    # no way between: each state keeps its better action
    transition = torch.eye(2, dtype=torch.float64)[:, None, :].expand(2, 2, 2).unsqueeze(0)
    plan = policy_iteration(transition, tensor([[[1, 3], [2, 0]]]), NEARLY_ONE)
    assert plan.policy.tolist() == [[1, 0]]


def test_the_planners_discount_finds_the_average_reward_policy() -> None:
    mdp = Advertiser().mdp
    plan = policy_iteration(mdp.transition[None], mdp.reward[None], NEARLY_ONE)
    assert torch.equal(plan.policy[0], mdp.optimal.policy)
    torch.testing.assert_close(plan.gain[0], mdp.optimal.gain, atol=1e-5, rtol=0)


def test_ties_keep_the_current_action_else_the_first() -> None:
    transition, _ = random_mdp(3, states=4)
    transition = transition[:, :, :1].expand(1, 4, 3, 4)
    reward = torch.ones(1, 4, 3, dtype=torch.float64)
    assert policy_iteration(transition, reward).policy.tolist() == [[0, 0, 0, 0]]
    start = torch.tensor([[2, 1, 0, 2]])
    assert torch.equal(policy_iteration(transition, reward, policy=start).policy, start)
    reward[..., 0] -= 1  # now action 0 is worse, and the first of the others is taken
    assert policy_iteration(transition, reward).policy.tolist() == [[1, 1, 1, 1]]


def test_first_best_ignores_rounding() -> None:
    values = tensor([[[1.0, 1.0 + 1e-12, 0.0], [0.0, 1.0, 1.0 - 1e-12], [0.0, 1e-6, 0.0]]])
    assert first_best(values).tolist() == [[0, 1, 1]]


@pytest.mark.parametrize("discount", [1.0, NEARLY_ONE, 0.9])
def test_the_result_does_not_depend_on_the_batch(discount: float) -> None:
    transition, reward = random_mdp(11, replicas=40, states=10)
    reward = reward.round(decimals=1)  # some near ties
    together = policy_iteration(transition, reward, discount)
    for i in range(40):
        alone = policy_iteration(transition[i : i + 1], reward[i : i + 1], discount)
        assert torch.equal(alone.policy[0], together.policy[i])
        torch.testing.assert_close(alone.bias[0], together.bias[i], atol=1e-9, rtol=0)


def test_a_warm_start_changes_nothing_but_the_time() -> None:
    transition, reward = random_mdp(5, replicas=10)
    cold = policy_iteration(transition, reward)
    warm = policy_iteration(
        transition, reward, policy=torch.randint(3, (10, 6), generator=torch.Generator().manual_seed(1))
    )
    assert torch.equal(cold.policy, warm.policy)
    torch.testing.assert_close(cold.gain, warm.gain)


@given(st.integers(0, 10_000))
def test_policies_equal_the_second_implementation(seed: int) -> None:
    transition, reward = random_mdp(seed, states=10)
    expected = naive.plan(transition[0].numpy(), reward[0].numpy(), np.zeros(10, dtype=int))
    assert policy_iteration(transition, reward).policy[0].tolist() == expected.tolist()


def test_stationary_distribution_by_hand() -> None:
    # Action 1 in state 0, action 0 in state 1: the chain above, with (1/3, 2/3)
    transition = tensor([[[1, 0], [0.5, 0.5]], [[0.25, 0.75], [0, 1]]])
    torch.testing.assert_close(stationary(transition, torch.tensor([1, 0])), tensor([1 / 3, 2 / 3]))


def ring(states: int, steps: tuple[int, ...], slip: float = 0.0) -> torch.Tensor:
    """A ring where action i moves by steps[i], and slips (stays) with some probability."""
    transition = torch.zeros(states, len(steps), states, dtype=torch.float64)
    for s in range(states):
        for a, step in enumerate(steps):
            transition[s, a, (s + step) % states] += 1 - slip
            transition[s, a, s] += slip
    return transition


@pytest.mark.parametrize(
    ("transition", "expected"),
    [
        (ring(6, (1,)), 5),  # once around, the wrong way
        (ring(6, (1, -1)), 3),
        (ring(7, (1, -1), slip=0.5), 6),  # 3 steps of 2 trials each
        (ring(2, (1,)), 1),
    ],
)
def test_diameter_of_a_ring(transition: torch.Tensor, expected: float) -> None:
    assert diameter(transition) == pytest.approx(expected, abs=1e-6)


def test_diameter_of_the_advertiser_is_nine_states_at_sixty_per_cent() -> None:
    assert Advertiser().mdp.diameter == pytest.approx(9 / 0.6)


def test_the_diameter_is_infinite_where_a_state_cannot_be_reached() -> None:
    transition = ring(4, (0, 1))
    transition[3, 1] = transition[3, 0]  # state 3 keeps whoever arrives
    assert diameter(transition) == float("inf")


def test_the_diameter_is_infinite_whatever_the_rounding() -> None:
    for seed in range(12):
        transition = random_mdp(seed, states=5)[0][0].clone()
        transition[..., 0] = 0  # nothing leads to state 0
        transition /= transition.sum(-1, keepdim=True)
        assert diameter(transition) == float("inf"), seed

"""Exact episodic MDPs: dynamic programming against plain sums, replicas, and the Gymnasium face."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.core.windows import Windows
from credit.envs.exact.episodic import EpisodicEnvironment, EpisodicGymEnv, SuccessorMDP
from credit.envs.feedback import BlockSum

from ..collecting import Function
from ..collecting import collected as collected_in

STATES, ACTIONS, WIDTH = 4, 2, 3


def small_mdp() -> SuccessorMDP:
    """A random MDP with 4 states, 2 actions and 3 successors a row, one of them padding in some rows."""
    random = np.random.default_rng(5)
    successors = np.stack([random.permutation(STATES)[:WIDTH] for _ in range(STATES * ACTIONS)])
    weights = random.random((STATES * ACTIONS, WIDTH))
    weights[::3, 1] = 0
    weights[1::3, 2] = 0
    return SuccessorMDP(
        torch.from_numpy(successors),
        torch.from_numpy(weights / weights.sum(1, keepdims=True)),
        torch.tensor([0.5, -1.0, 2.0, 0.0], dtype=FLOAT),
        torch.tensor([0.0, 0.7, 0.3, 0.0], dtype=FLOAT),
    )


def dense(mdp: SuccessorMDP) -> np.ndarray:
    """P [S, A, S]."""
    table = np.zeros((STATES * ACTIONS, STATES))
    for row, (states, probabilities) in enumerate(zip(mdp.next_states, mdp.probabilities, strict=True)):
        np.add.at(table[row], states.numpy(), probabilities.numpy())
    return table.reshape(STATES, ACTIONS, STATES)


def by_enumeration(mdp: SuccessorMDP, policy: np.ndarray, additive: bool) -> float:
    """The value of a policy [T, S, A], summed over every path."""
    table, initial, reward = dense(mdp), mdp.initial.numpy(), mdp.reward_next.numpy()
    total = 0.0
    for path in product(range(STATES), repeat=len(policy) + 1):
        probability = initial[path[0]]
        for t, (now, then) in enumerate(pairwise(path)):
            probability *= policy[t, now] @ table[now, :, then]
        total += probability * (reward[list(path[1:])].sum() if additive else reward[path[-1]])
    return total


class Small(EpisodicEnvironment):
    """Replicas of the small MDP."""

    mdp = small_mdp()


def collected(seeds: tuple[int, ...], act: Function, windows: int, steps: int = 3) -> tuple[Windows, torch.Tensor]:
    """Windows, and primitive rewards [R, K, T]."""
    return collected_in(Small(), BlockSum(3, noise=0.2), seeds, act, windows, steps)


def test_sizes_and_backup() -> None:
    mdp = small_mdp()
    assert (mdp.states, mdp.actions) == (STATES, ACTIONS)
    values = torch.randn(5, 3, STATES, dtype=FLOAT, generator=torch.Generator().manual_seed(1))
    expected = torch.einsum("san,bcn->bcsa", torch.from_numpy(dense(mdp)), values)
    torch.testing.assert_close(mdp.backup(values), expected)
    torch.testing.assert_close(mdp.backup(values[0, 0]), expected[0, 0])
    torch.testing.assert_close(mdp.reward, torch.from_numpy(dense(mdp)) @ mdp.reward_next)


@pytest.mark.parametrize("additive", [True, False])
def test_evaluation_is_the_sum_over_paths(additive: bool) -> None:
    mdp, random = small_mdp(), np.random.default_rng(2)
    policies = torch.from_numpy(random.integers(ACTIONS, size=(3, 3, STATES)))
    chosen = torch.nn.functional.one_hot(policies, ACTIONS).to(FLOAT)
    mixed = torch.from_numpy(random.dirichlet([1.0] * ACTIONS, (3, 3, STATES)))
    for policy, weights in ((policies, chosen), (chosen, chosen), (mixed, mixed)):
        expected = [by_enumeration(mdp, one, additive) for one in weights.numpy()]
        assert mdp.evaluate(policy, additive).tolist() == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("additive", [True, False])
def test_no_policy_is_better_than_the_optimal_one(additive: bool) -> None:
    mdp = small_mdp()
    values, policy = mdp.optimal(2, additive)
    assert values.shape == (3, STATES)
    assert policy.shape == (2, STATES)
    every = torch.tensor(list(product(range(ACTIONS), repeat=2 * STATES))).view(-1, 2, STATES)
    best = float(mdp.evaluate(every, additive).max())
    assert float(values[0] @ mdp.initial) == pytest.approx(best, abs=1e-12)
    assert float(mdp.evaluate(policy.unsqueeze(0), additive)) == pytest.approx(best, abs=1e-12)
    assert torch.equal(values[2], torch.zeros(STATES, dtype=FLOAT) if additive else mdp.reward_next)


def test_of_tied_actions_the_first_is_taken() -> None:
    mdp = SuccessorMDP(
        torch.zeros(2 * 3, 1, dtype=torch.int64), torch.ones(6, 1), torch.ones(2), torch.tensor([1.0, 0])
    )
    assert mdp.optimal(2, True)[1].tolist() == [[0, 0], [0, 0]]


def test_a_policy_is_worth_alone_what_it_is_in_a_batch() -> None:
    policies = torch.randint(ACTIONS, (9, 4, STATES), generator=torch.Generator().manual_seed(0))
    together = Small.mdp.evaluate(policies, True)
    alone = torch.cat([Small.mdp.evaluate(one.unsqueeze(0), True) for one in policies])
    torch.testing.assert_close(together, alone, rtol=1e-12, atol=0)


@pytest.mark.parametrize("row", [[0.5, 0.4, 0.0], [1.2, -0.2, 0.0], [0.6, 0.6, 0.6]])
def test_a_row_that_is_no_distribution_is_refused(row: list[float]) -> None:
    mdp = small_mdp()
    probabilities = mdp.probabilities.clone()
    probabilities[5] = torch.tensor(row)
    with pytest.raises(UserError, match=rf"\(s=2, a=1\) is no distribution.*{max(row):g}.*sum {sum(row):.6g};"):
        SuccessorMDP(mdp.next_states, probabilities, mdp.reward_next, mdp.initial)


@pytest.mark.parametrize("initial", [[0.5, 0.4, 0.0, 0.0], [1.5, -0.5, 0.0, 0.0]])
def test_an_initial_distribution_that_is_none_is_refused(initial: list[float]) -> None:
    mdp = small_mdp()
    with pytest.raises(UserError, match="initial distribution"):
        SuccessorMDP(mdp.next_states, mdp.probabilities, mdp.reward_next, torch.tensor(initial))


def test_a_horizon_of_zero_is_refused() -> None:
    mdp = small_mdp()
    for refused in (
        lambda: mdp.optimal(0, True),
        lambda: mdp.evaluate(torch.zeros(1, 0, STATES, dtype=torch.int64), True),
        lambda: EpisodicGymEnv(mdp, 0),
    ):
        with pytest.raises(UserError, match=r"horizon=0.*at least 1"):
            refused()


def test_every_window_is_an_episode() -> None:
    told: list[int] = []

    def act(states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        assert states.shape == step.shape == (2, 1)
        assert (step == step[0, 0]).all()
        told.append(int(step[0, 0]))
        return (states + step) % ACTIONS

    windows, primitive = collected((3, 4), act, 200)
    assert told == [0, 1, 2] * 200
    assert windows.states.shape == windows.actions.shape == windows.next_states.shape == (2, 600)
    assert windows.length == 3
    states, actions, arrivals = (windows.grid(p) for p in (windows.states, windows.actions, windows.next_states))
    assert torch.equal(states[..., 1:], arrivals[..., :-1])
    assert set(states[..., 0].flatten().tolist()) == {1, 2}
    assert torch.equal(actions, (states + torch.arange(3)) % ACTIONS)
    assert torch.equal(primitive, Small.mdp.reward_next[arrivals])
    assert windows.primitive is None
    error = windows.labels - primitive.sum(-1)
    assert 0.15 < float(error.std()) < 0.25


def test_steps_follow_the_transition_table() -> None:
    generator = torch.Generator().manual_seed(4)
    act = lambda states, step: torch.randint(ACTIONS, states.shape, generator=generator)  # noqa: E731
    windows, _ = collected(tuple(range(100)), act, 300)
    counts = np.zeros((STATES, ACTIONS, STATES))
    np.add.at(counts, tuple(part.numpy().ravel() for part in (windows.states, windows.actions, windows.next_states)), 1)
    visits, table = counts.sum(-1, keepdims=True), dense(Small.mdp)
    assert (counts[table == 0] == 0).all()
    error = (counts / visits - table) / np.sqrt(np.maximum(table * (1 - table) / visits, 1e-12))
    assert np.abs(error).max() < 4
    first = (windows.grid(windows.states)[..., 0] == 1).double().mean()
    assert abs(float(first) - 0.7) < 4 * np.sqrt(0.7 * 0.3 / 30_000)


def test_an_episode_can_be_cut_short() -> None:
    act = lambda states, step: torch.zeros_like(states)  # noqa: E731
    whole, _ = collected((0, 1), act, 1)
    cut, primitive = collected((0, 1), act, 1, steps=2)
    assert primitive.shape == (2, 1, 2)
    assert torch.equal(cut.next_states, whole.next_states[:, :2])


def test_the_objective_decides_what_is_true() -> None:
    env = Small()
    both = [env.truth(objective, 3).best for objective in ("sum", "last")]
    assert both == [pytest.approx(float(Small.mdp.optimal(3, a)[0][0] @ Small.mdp.initial)) for a in (True, False)]
    with pytest.raises(UserError, match=r"asks for 'median'.*'sum'.*'last'"):
        env.truth("median", 3)


def test_a_replica_takes_the_same_steps_alone() -> None:
    act = lambda states, step: states % ACTIONS  # noqa: E731
    batch, _ = collected((5, 6, 7), act, 300)
    alone, _ = collected((6,), act, 300)
    assert torch.equal(batch.states[1], alone.states[0])
    assert torch.equal(batch.next_states[1], alone.next_states[0])
    assert torch.equal(batch.labels[1], alone.labels[0])
    assert not torch.equal(batch.states[0], batch.states[1])


def test_the_problem_tells_sizes_only() -> None:
    problem = Small().problem(3, (3, 4), "cpu")
    assert (problem.states, problem.actions, problem.window, problem.seeds) == (STATES, ACTIONS, 3, (3, 4))


def test_gymnasium_episodes_end_at_the_horizon() -> None:
    env = EpisodicGymEnv(small_mdp(), horizon=3)
    for seed in range(20):
        state, info = env.reset(seed=seed)
        assert state in (1, 2)
        assert info == {"step": 0}
        for step in (1, 2, 3):
            row = state * ACTIONS
            state, reward, terminated, truncated, info = env.step(0)
            assert state in env.mdp.next_states[row][env.mdp.probabilities[row] > 0]
            assert reward == float(env.mdp.reward_next[state])
            assert (terminated, truncated, info) == (step == 3, False, {"step": step})
        with pytest.raises(UserError, match=r"ended after 3 steps.*reset"):
            env.step(0)


@pytest.mark.parametrize("action", [-1, 2])
def test_gymnasium_refuses_an_action_that_does_not_exist(action: int) -> None:
    env = EpisodicGymEnv(small_mdp(), horizon=3)
    env.reset(seed=0)
    with pytest.raises(UserError, match=f"action={action}.*0 to 1"):
        env.step(action)

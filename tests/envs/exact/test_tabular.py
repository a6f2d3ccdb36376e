"""Replicas of an exact MDP, and its Gymnasium face."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import scipy.stats
import torch
from gymnasium.utils.env_checker import check_env

import credit  # noqa: F401 - registers credit/Advertiser-v0
from credit.core.errors import UserError
from credit.core.windows import Windows
from credit.envs.advertiser.environment import Advertiser
from credit.envs.exact.continuing import TabularMDP
from credit.envs.feedback import BlockSum

from ..collecting import Follow, Function, begun
from ..collecting import collected as collected_in


def uniform_policy(seed: int) -> Function:
    generator = torch.Generator().manual_seed(seed)
    return lambda states, step: torch.randint(3, states.shape, generator=generator)


def collected(env: Advertiser, seeds: tuple[int, ...], act: Function, windows: int) -> tuple[Windows, torch.Tensor]:
    """Windows, and primitive rewards [R, K, T]."""
    return collected_in(env, BlockSum(7, noise=0.2), seeds, act, windows)


def p_value(counts: np.ndarray, transition: np.ndarray) -> float:
    """Chi-square test of counts [S, A, S] against P; impossible moves must not have happened."""
    assert (counts[transition == 0] == 0).all()
    expected = counts.sum(-1, keepdims=True) * transition
    possible = transition > 0
    statistic = ((counts - expected)[possible] ** 2 / expected[possible].clip(1e-300)).sum()
    freedom = (possible.sum(-1) - 1)[counts.sum(-1) > 0].sum()
    assert expected[possible].min() > 5
    return float(scipy.stats.chi2.sf(statistic, freedom))


def test_steps_follow_the_transition_matrix() -> None:
    env = Advertiser(initial_state=5)
    windows, _ = collected(env, tuple(range(40)), uniform_policy(1), 200)  # 56,000 steps
    counts = np.zeros((10, 3, 10))
    np.add.at(counts, tuple(part.numpy().ravel() for part in (windows.states, windows.actions, windows.next_states)), 1)
    assert p_value(counts, env.mdp.transition.numpy()) > 1e-3


def test_windows_are_one_unbroken_walk() -> None:
    env = Advertiser(initial_state=3)
    windows, primitive = collected(env, (0, 1), uniform_policy(2), 30)
    assert (windows.states[:, 0] == 3).all()
    assert torch.equal(windows.states[:, 1:], windows.next_states[:, :-1])
    assert torch.equal(primitive, windows.grid(env.mdp.reward[windows.states, windows.actions]))
    assert windows.primitive is None
    error = windows.labels - primitive.sum(-1)
    assert 0.1 < float(error.std()) < 0.3


def test_the_walk_goes_on_in_the_next_call() -> None:
    act = lambda states, step: torch.full_like(states, 2)  # noqa: E731
    collector, _ = begun(Advertiser(), BlockSum(7), (0, 1))
    pieces = [collector.collect(Follow(act), count)[0] for count in (1, 3, 2)]
    states = torch.cat([piece.states for piece in pieces], 1)
    assert torch.equal(states[:, 1:], torch.cat([piece.next_states for piece in pieces], 1)[:, :-1])
    together, _ = collected(Advertiser(), (0, 1), act, 6)
    assert torch.equal(together.states, states)


def test_the_policy_is_told_the_step_of_the_window() -> None:
    told: list[int] = []

    def act(states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        told.append(int(step[0, 0]))
        return torch.zeros_like(states)

    collected(Advertiser(), (0,), act, 2)
    assert told == [*range(7), *range(7)]


def test_regret_is_known_for_the_sum_of_rewards_alone() -> None:
    env = Advertiser()
    assert env.truth("sum", 7).gain == pytest.approx(float(env.mdp.optimal.gain))
    with pytest.raises(UserError, match=r"asks for 'last'.*'sum', like block_sum"):
        env.truth("last", 7)


def test_the_problem_tells_sizes_only() -> None:
    problem = Advertiser(states=6).problem(5, (3, 4), "cpu")
    assert (problem.states, problem.actions, problem.window, problem.seeds) == (6, 3, 5, (3, 4))
    assert (problem.replicas, problem.pairs) == (2, 18)
    assert problem.zeros(4).shape == (2, 4)


@pytest.mark.parametrize("row", [[0.5, 0.4], [1.2, -0.2], [0.6, 0.6]])
def test_a_row_that_is_no_distribution_is_refused(row: list[float]) -> None:
    transition = torch.tensor([[[1.0, 0.0]], [row]], dtype=torch.float64)
    with pytest.raises(UserError, match=r"\(s=1, a=0\) is no distribution"):
        TabularMDP(transition, torch.zeros(2, 1), torch.tensor([1.0, 0.0]))


def test_gymnasium_accepts_the_environment() -> None:
    check_env(gymnasium.make("credit/Advertiser-v0").unwrapped)


def test_gymnasium_steps_follow_the_transition_matrix() -> None:
    env = gymnasium.make("credit/Advertiser-v0", initial_state=5).unwrapped
    mdp = Advertiser(initial_state=5).mdp
    state, _ = env.reset(seed=12)
    assert state == 5
    counts = np.zeros((10, 3, 10))
    for action in np.random.default_rng(3).integers(3, size=12_000):
        then, reward, terminated, truncated, _ = env.step(int(action))
        assert reward == float(mdp.reward[state, action])
        assert not terminated
        assert not truncated
        counts[state, action, then] += 1
        state = then
    assert p_value(counts, mdp.transition.numpy()) > 1e-3


def test_gymnasium_renders_text() -> None:
    env = gymnasium.make("credit/Advertiser-v0", initial_state=2, render_mode="ansi")
    env.reset(seed=0)
    assert env.render() == "··●·······"


def test_gymnasium_refuses_wrong_parameters() -> None:
    with pytest.raises(UserError, match=r"env\.initial_state=12"):
        gymnasium.make("credit/Advertiser-v0", initial_state=12)


def test_seeds_decide_the_walk() -> None:
    act = lambda states, step: torch.ones_like(states)  # noqa: E731
    batch, _ = collected(Advertiser(), (5, 6, 7), act, 12)
    alone, _ = collected(Advertiser(), (6,), act, 12)
    assert torch.equal(batch.states[1], alone.states[0])
    assert torch.equal(batch.labels[1], alone.labels[0])
    assert not torch.equal(batch.states[0], batch.states[1])

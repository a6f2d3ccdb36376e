"""Environments that are lists of outcomes: P, rewards and noise that are drawn, the exact judge, what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import torch

from credit.agents.random import Random
from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.envs.collect import Collector
from credit.envs.deepsea.environment import DeepSea
from credit.envs.exact.outcomes import Outcome, OutcomeEnvironment
from credit.envs.feedback import BlockSum, Success
from credit.envs.umbrella.environment import Umbrella
from credit.envs.watch_repair.environment import WatchRepair
from credit.judges.choose import judge
from credit.judges.exact import Episodic
from credit.judges.rollouts import Rollouts

from ..collecting import begun, collected
from .plain import value


class Two(OutcomeEnvironment):
    """Two places, once more in every step; action 1 in place 0 may lead to place 1 in two ways, and is noisy."""

    def __init__(self, horizon: int = 3, wrong: float = 0.0) -> None:
        self.horizon, self.wrong = horizon, wrong
        self.sizes = (2 * horizon + 2, 2)

    def first(self) -> dict[int, float]:
        return {0: 0.75, 1: 0.25 + self.wrong}

    def outcomes(self, state: int, action: int) -> Sequence[Outcome]:
        time, place = divmod(state, 2)
        if time == self.horizon:
            return []
        then = 2 * time + 2
        if (place, action) == (0, 1):
            return [(0.5, then + 1, 2.0), (0.3, then + 1, -1.0), (0.2, then, 0.5)]
        return [(1.0, then, float(place))]

    def deviation(self, state: int, action: int) -> float:
        return 0.5 if state % 2 == 0 and action == 1 and state < 2 * self.horizon else 0.0


EVERY = [Two(), DeepSea(4), DeepSea(3, windy=True, mapping=1), Umbrella(3, 0), WatchRepair(3)]


def named(env: OutcomeEnvironment) -> str:
    return type(env).__name__


def test_tables_by_hand() -> None:
    mdp = Two(1).mdp
    assert mdp.pairs.goes_on.toarray().tolist() == [
        *([0, 0, 1, 0], [0, 0, 0.2, 0.8]),
        *([0, 0, 1, 0], [0, 0, 1, 0]),
        *([0, 0, 1, 0], [0, 0, 1, 0]),  # the ends
        *([0, 0, 0, 1], [0, 0, 0, 1]),
    ]
    assert mdp.pairs.reward.tolist() == [[0, pytest.approx(0.8)], [1, 1], [0, 0], [0, 0]]  # .5·2 − .3·1 + .2·.5
    assert mdp.deviation.tolist() == [0, 0.5, 0, 0, 0, 0, 0, 0]
    assert mdp.final.tolist() == [False, False, True, True]
    torch.testing.assert_close(
        mdp.transitions.backup(torch.tensor([9.0, 9.0, 1.0, 3.0], dtype=FLOAT))[:2],
        torch.tensor([[1.0, 2.6], [1.0, 1.0]], dtype=FLOAT),
    )


@pytest.mark.parametrize("env", EVERY, ids=named)
def test_values_are_those_of_plain_loops(env: OutcomeEnvironment) -> None:
    for steps in (1, env.horizon):
        truth = env.truth("sum", steps)
        assert truth is not None
        assert truth.best == pytest.approx(value(env, steps), abs=1e-12)
        policy = np.random.default_rng(0).dirichlet(np.ones(env.sizes[1]), (steps, env.sizes[0]))
        assert float(truth.evaluate(torch.from_numpy(policy)[None])) == pytest.approx(value(env, steps, policy))
        assert truth.random == pytest.approx(value(env, steps, np.full_like(policy, 1 / env.sizes[1])))


@pytest.mark.parametrize("env", EVERY, ids=named)
def test_what_is_drawn_has_the_law_of_the_tables(env: OutcomeEnvironment) -> None:
    """Successors of every pair that was seen often, and the mean and deviation of its rewards."""
    problem = env.problem(None, (0, 1))
    assert problem.window == env.horizon
    env.start(problem, copies=800)
    mdp, rows, states, rewards = env.mdp, [], [], []
    generator = torch.Generator().manual_seed(0)
    for _ in range(2):
        now = env.reset()
        for _ in range(env.horizon):
            actions = torch.randint(2, now.shape, generator=generator)
            rows.append((now * 2 + actions).flatten())
            out = env.step(actions)
            now = out.states
            states.append(now.flatten())
            rewards.append(out.rewards.flatten())
    row, then, reward = torch.cat(rows), torch.cat(states), torch.cat(rewards)
    square = (mdp.probabilities * mdp.rewards.square()).sum(-1) + mdp.deviation.square()
    checked = 0
    for n in row.unique().tolist():
        of = row == n
        count = int(of.sum())
        if count < 150:
            continue
        checked += 1
        share = torch.bincount(then[of], minlength=problem.states).numpy() / count
        law = mdp.pairs.goes_on.toarray()[n]
        assert np.abs(share - law).max() < 5 * np.sqrt(0.25 / count)
        mean = mdp.pairs.reward.flatten()[n]
        deviation = float((square[n] - mean.square()).clamp(min=0).sqrt())
        assert abs(float(reward[of].mean() - mean)) <= 5 * deviation / count**0.5 + 1e-12
        assert float(reward[of].std()) == pytest.approx(deviation, rel=0.25, abs=1e-9)
    assert checked >= 2


def test_a_replica_alone_draws_the_same_and_goes_on() -> None:
    def ones(states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        return torch.ones_like(states)

    both, primitive = collected(Two(), BlockSum(3, 0.1), (7, 8), ones, 5)
    alone, of_alone = collected(Two(), BlockSum(3, 0.1), (8,), ones, 5)
    assert torch.equal(both.states[1:], alone.states)
    assert torch.equal(primitive[1:], of_alone)
    collector, problem = begun(Two(), BlockSum(3, 0.0))
    random = Random()
    random.start(problem)
    collector.collect(random, 2)
    state = (collector._env.state_dict(), random.state_dict())
    expected, rewards = collector.collect(random, 2)
    other, again = Two(), Random()
    for part, held in zip((other, again), state, strict=True):
        part.start(problem)
        part.load_state_dict(held)
    feedback = BlockSum(3, 0.0)
    feedback.start(problem)
    found, those = Collector(other, feedback, problem).collect(again, 2)
    assert torch.equal(found.states, expected.states)
    assert torch.equal(those, rewards)


@pytest.mark.parametrize(("feedback", "kind"), [(BlockSum(3), Episodic), (Success(3), Rollouts)])
def test_sums_are_judged_exactly_and_the_rest_by_rollouts(feedback: Any, kind: type) -> None:
    env = Two()
    collector, problem = begun(env, feedback)
    assert isinstance(judge(env, feedback, problem, collector.evaluation), kind)


def test_episodes_end_with_the_horizon_and_others_begin() -> None:
    env = Two()
    problem = env.problem(2, (0, 1))
    assert (problem.window, problem.horizon) == (2, 3)
    env.start(problem, copies=2)
    env.reset()
    steps = [env.step(torch.ones(2, 2, dtype=torch.int64)).terminated for _ in range(3)]
    assert [bool(ended.all()) for ended in steps if ended is not None] == [False, False, True]
    again = env.reset(torch.tensor([[True, False], [True, True]]))
    assert (again.flatten()[[0, 2, 3]] < 2).all()
    assert again[0, 1] >= 6


def test_windows_inside_episodes() -> None:
    env, feedback, random = Two(5), BlockSum(2, 0.0), Random()
    problem = env.problem(feedback.window, (0, 1))
    for part in (env, feedback, random):
        part.start(problem)
    found = Collector(env, feedback, problem).roll(random, 20)
    assert found is not None
    windows, rewards = found
    assert windows.lengths.tolist() == [[2, 2, 1] * 4] * 2  # the end of an episode cuts a window short
    torch.testing.assert_close(windows.sums(rewards), windows.labels)


def test_what_is_refused() -> None:
    with pytest.raises(UserError, match=r"the initial distribution .* sum 1.1"):
        _ = Two(wrong=0.1).mdp

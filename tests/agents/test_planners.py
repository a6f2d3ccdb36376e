"""Value iteration on what is believed, and the random policy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from credit.agents.random import Random
from credit.agents.value_iteration import ValueIteration
from credit.core.dataset import Dataset
from credit.core.types import Problem, Windows
from credit.planning.counts import Counts
from credit.planning.solve import policy_iteration
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import ReferenceOnly
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import RewardRecovery
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.rivals.rules import Delayed

Make = Callable[..., Problem]


def planner(problem: Problem, windows: Windows, **parameters: Any) -> tuple[ValueIteration, RewardRecovery]:
    recovery = RewardRecovery(
        LinearModel("ridge", Identity()), {}, Bootstrap(3), ReferenceOnly(), {"count": Count(2.0)}
    )
    optimizer = ValueIteration(Counts(), **parameters)
    for part in (recovery, optimizer):
        part.start(problem)
    dataset = Dataset(problem, 1)
    dataset.append(windows)
    recovery.observe(dataset)
    optimizer.improve(dataset, recovery)
    return optimizer, recovery


def test_it_acts_by_the_plan_and_is_judged_without_the_bonus(
    make_problem: Make, make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 40)
    optimizer, recovery = planner(problem, windows)
    counts = Counts()
    counts.start(problem)
    counts.observe(windows)
    found, policies = recovery.recovery(), optimizer.policies()
    for name, reward in (("behaviour", found.plan), ("greedy", found.mixed)):
        expected = policy_iteration(counts.probabilities(), reward.view(2, 10, 3)).policy
        assert torch.equal(policies[name], expected), name
    assert not torch.equal(policies["behaviour"], policies["greedy"])
    for state in range(10):
        states = torch.full((2,), state)
        assert torch.equal(optimizer.act(states, 0), policies["behaviour"][:, state])


def test_a_small_discount_is_myopic(make_problem: Make, make_windows: Callable[..., Windows]) -> None:
    problem = make_problem((0, 1))
    optimizer, recovery = planner(problem, make_windows(problem, 40), discount=1e-9)
    best = recovery.recovery().plan.view(2, 10, 3).argmax(-1)
    assert torch.equal(optimizer.policies()["behaviour"], best)


def test_before_anything_is_known_it_plays_action_zero(make_problem: Make) -> None:
    optimizer = ValueIteration(Counts())
    optimizer.start(make_problem((0, 1)))
    assert optimizer.act(torch.tensor([3, 4]), 0).tolist() == [0, 0]
    assert list(optimizer.policies()) == ["behaviour"]


def test_random_actions_are_uniform_and_belong_to_the_seed(
    make_problem: Make, make_windows: Callable[..., Windows]
) -> None:
    problem, alone = make_problem(range(20)), make_problem((7,))
    batch, single = Random(), Random()
    batch.start(problem)
    single.start(alone)
    dataset = Dataset(problem, 1)
    dataset.append(make_windows(problem, 1))
    actions = torch.stack([batch.act(torch.zeros(20, dtype=torch.int64), t) for t in range(300)])
    assert torch.equal(torch.stack([single.act(torch.tensor([9]), t) for t in range(300)])[:, 0], actions[:, 7])
    shares = actions.flatten().bincount(minlength=3) / 6000
    assert (shares - 1 / 3).abs().max() < 5 * (2 / 9 / 6000) ** 0.5
    batch.improve(dataset, Delayed())
    assert batch.policies() == {}

"""Finite-horizon planning (A.2) against plain NumPy value iteration on the same counts."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
import torch

from credit.agents.finite_horizon import FiniteHorizon
from credit.core.cells import PAIRS, Cells
from credit.core.dataset import Dataset
from credit.core.tables import RewardFunction, TransitionModel
from credit.core.types import FLOAT, Problem, Recovery, Windows
from credit.planning.counts import Counts, ObservedCounts

Make = Callable[..., Problem]
STATES, ACTIONS, WINDOW = 6, 3, 4
CELLS = Cells(PAIRS, (STATES, ACTIONS))


class Believed(RewardFunction):
    """An assigner that believes in given tables [R, S·A]."""

    def __init__(self, mixed: torch.Tensor, plan: torch.Tensor) -> None:
        none = mixed.unsqueeze(1)[:, :0]
        self._recovery = Recovery((), none, (), none, none, none, mixed.long(), mixed, {}, plan, mixed, CELLS)

    def start(self, problem: Problem) -> None: ...

    def observe(self, dataset: Dataset) -> None: ...

    def recovery(self) -> Recovery:
        return self._recovery

    def rewards(self, windows: Windows) -> torch.Tensor:
        raise NotImplementedError


@pytest.fixture
def problem(make_problem: Make) -> Problem:
    return make_problem((0, 1, 2), states=STATES, actions=ACTIONS, window=WINDOW)


def random_tables(problem: Problem, count: int, seed: int = 0) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.randn(problem.replicas, problem.pairs, dtype=FLOAT, generator=generator) for _ in range(count)]


def planned(problem: Problem, dataset: Dataset, transition: TransitionModel, believed: Believed) -> FiniteHorizon:
    optimizer = FiniteHorizon(transition)
    optimizer.start(problem)
    optimizer.improve(dataset, believed)
    return optimizer


def filled(problem: Problem, windows: Windows) -> Dataset:
    dataset = Dataset(problem, 1)
    dataset.append(windows)
    return dataset


def value_iteration(windows: Windows, replica: int, reward: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Q_t = r + P̂ max Q_{t+1} with P̂ = N/max(1, N): values [T, S, A] and first best policy [T, S]."""
    counts = np.zeros((STATES, ACTIONS, STATES))
    steps = (windows.states, windows.actions, windows.next_states)
    np.add.at(counts, tuple(part[replica].numpy().ravel() for part in steps), 1)
    transition = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    value, found = np.zeros(STATES), []
    for _ in range(WINDOW):
        ahead = reward[replica].numpy().reshape(STATES, ACTIONS) + transition @ value
        value = ahead.max(-1)
        found.insert(0, ahead)
    return np.stack(found), np.stack(found).argmax(-1)


@pytest.mark.parametrize("transition", [ObservedCounts(), Counts("zero", 0.0)], ids=["observed", "table"])
@pytest.mark.parametrize("windows", [2, 60])
def test_plans_equal_plain_value_iteration(
    problem: Problem, make_windows: Callable[..., Windows], transition: TransitionModel, windows: int
) -> None:
    seen = make_windows(problem, windows)
    mixed, plan = random_tables(problem, 2)
    optimizer = planned(problem, filled(problem, seen), transition, Believed(mixed, plan))
    policies = optimizer.policies()
    for name, reward in (("behaviour", plan), ("greedy", mixed)):
        assert policies[name].shape == (3, WINDOW, STATES)
        for replica in range(3):
            np.testing.assert_array_equal(policies[name][replica], value_iteration(seen, replica, reward)[1])
    assert not torch.equal(policies["behaviour"], policies["greedy"])
    assert not torch.equal(policies["behaviour"][:, 0], policies["behaviour"][:, -1])  # it depends on the step
    assert torch.equal(optimizer.executed(), policies["behaviour"])


def test_counts_add_up_from_round_to_round(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    windows, believed = make_windows(problem, 30), Believed(*random_tables(problem, 2))
    whole = planned(problem, filled(problem, windows), ObservedCounts(), believed)
    rounds, dataset = FiniteHorizon(ObservedCounts()), Dataset(problem, 1)
    rounds.start(problem)
    for rows in (slice(1), slice(1, 12), slice(12, 30)):
        parts = (windows.states, windows.actions, windows.next_states, windows.labels)
        dataset.append(Windows(*(part[:, rows] for part in parts)))
        rounds.improve(dataset, believed)
    assert torch.equal(rounds.executed(), whole.executed())


def test_it_acts_by_its_policy_of_the_step(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    believed = Believed(*random_tables(problem, 2))
    optimizer = planned(problem, filled(problem, make_windows(problem, 30)), ObservedCounts(), believed)
    policy = optimizer.executed()
    for step in range(WINDOW):
        for states in (torch.tensor([0, 3, 5]), torch.tensor([4, 4, 1])):
            assert torch.equal(optimizer.act(states, step), policy[torch.arange(3), step, states])


def test_at_the_start_every_action_is_tied_and_all_occur(make_problem: Make) -> None:
    problem = make_problem(range(20), states=100, actions=8, window=5)
    optimizer = FiniteHorizon(ObservedCounts())
    optimizer.start(problem)
    assert list(optimizer.policies()) == ["behaviour"]  # nothing is believed that one could plan with
    policy = optimizer.executed()
    assert policy.shape == (20, 5, 100)
    shares = policy[:, 0].flatten().bincount(minlength=8) / 2000
    assert (shares - 1 / 8).abs().max() < 5 * (7 / 64 / 2000) ** 0.5
    assert not torch.equal(policy[0], policy[1])
    alone = FiniteHorizon(ObservedCounts())
    alone.start(make_problem((7,), states=100, actions=8, window=5))
    assert torch.equal(alone.executed()[0], policy[7])


def test_ties_are_drawn_anew_among_the_best_alone(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    # Actions 0 and 2 are tied, within what rounding leaves; nothing that was seen tells them apart.
    reward = torch.tensor([1.0, 0.5, 1.0 - 1e-13], dtype=FLOAT).repeat(3, STATES)
    windows = make_windows(problem, 1)
    still = Windows(windows.states, windows.actions * 0 + 1, windows.states, windows.labels)
    optimizer, believed = FiniteHorizon(ObservedCounts()), Believed(reward, reward)
    dataset = filled(problem, still)
    optimizer.start(problem)
    plans = []
    for _ in range(40):
        optimizer.improve(dataset, believed)
        plans.append(optimizer.executed()[:, -1])
    assert not any(torch.equal(one, following) for one, following in pairwise(plans))
    shares = torch.stack(plans).flatten().bincount(minlength=3) / (40 * 3 * STATES)
    assert shares[1] == 0
    assert abs(float(shares[0]) - 0.5) < 5 * 0.5 / (40 * 3 * STATES) ** 0.5
    assert torch.equal(optimizer.policies()["greedy"], optimizer.policies()["behaviour"])  # one draw a plan, for both
    assert torch.equal(optimizer.policies()["behaviour"], optimizer.executed())  # looking does not draw

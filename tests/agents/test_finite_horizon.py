"""Finite-horizon planning (A.2) against plain NumPy value iteration on the same counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from credit.agents.finite_horizon import FiniteHorizon
from credit.core.cells import PAIRS, Cells
from credit.core.policy import TablePolicy, tabulate
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Transition
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.planning.counts import Counts, ObservedCounts

from .assigners import Believed

Make = Callable[..., Problem]
STATES, ACTIONS, WINDOW = 6, 3, 4
CELLS = Cells(PAIRS, (STATES, ACTIONS))
ENDINGS = (  # steps, then actions, next states, and whether nothing lies behind
    (6, (torch.zeros(6).long(), torch.zeros(6).long(), False)),
    (1, (torch.ones(1).long(), torch.full((1,), 2), True)),
)


@pytest.fixture
def problem(make_problem: Make) -> Problem:
    return make_problem((0, 1, 2), states=STATES, actions=ACTIONS, window=WINDOW)


def executed(agent: FiniteHorizon) -> torch.Tensor:
    """What is acted by [R, T, S]."""
    policy = agent.executed()
    assert isinstance(policy, TablePolicy)
    return policy.actions


def tables(agent: FiniteHorizon) -> dict[str, torch.Tensor]:
    """The policies as tables [R, T, S]."""
    return {name: policy.actions for name, policy in agent.policies().items() if isinstance(policy, TablePolicy)}


def random_tables(problem: Problem, count: int, seed: int = 0) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.randn(problem.replicas, problem.pairs, dtype=FLOAT, generator=generator) for _ in range(count)]


def planned(problem: Problem, store: Store, transition: Transition, believed: Believed) -> FiniteHorizon:
    agent = FiniteHorizon(transition)
    agent.start(problem)
    agent.improve(store, believed)
    return agent


def filled(problem: Problem, windows: Windows) -> Store:
    store = Store(problem)
    store.append(windows)
    return store


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
    problem: Problem, make_windows: Callable[..., Windows], transition: Transition, windows: int
) -> None:
    seen = make_windows(problem, windows)
    mixed, plan = random_tables(problem, 2)
    agent = planned(problem, filled(problem, seen), transition, Believed(mixed, plan, CELLS))
    policies = tables(agent)
    for name, reward in (("behaviour", plan), ("greedy", mixed)):
        assert policies[name].shape == (3, WINDOW, STATES)
        for replica in range(3):
            np.testing.assert_array_equal(policies[name][replica], value_iteration(seen, replica, reward)[1])
    assert not torch.equal(policies["behaviour"], policies["greedy"])
    assert not torch.equal(policies["behaviour"][:, 0], policies["behaviour"][:, -1])  # it depends on the step
    assert torch.equal(executed(agent), policies["behaviour"])


def test_counts_add_up_from_round_to_round(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    windows, believed = make_windows(problem, 30), Believed(*random_tables(problem, 2), CELLS)
    whole = planned(problem, filled(problem, windows), ObservedCounts(), believed)
    rounds, store = FiniteHorizon(ObservedCounts()), Store(problem)
    rounds.start(problem)
    for first, last in ((0, 1), (1, 12), (12, 30)):
        rows = slice(first * WINDOW, last * WINDOW)
        parts = (part[:, rows] for part in (windows.states, windows.actions, windows.next_states))
        store.append(Windows(*parts, labels=windows.labels[:, first:last], length=WINDOW))
        rounds.improve(store, believed)
    assert torch.equal(executed(rounds), executed(whole))


def test_it_acts_by_its_policy_of_the_step(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    believed = Believed(*random_tables(problem, 2), CELLS)
    agent = planned(problem, filled(problem, make_windows(problem, 30)), ObservedCounts(), believed)
    policy = executed(agent)
    states = torch.tensor([[0, 4], [3, 4], [5, 1]])
    for step in range(WINDOW):
        now = torch.full((3, 2), step)
        assert torch.equal(agent.act(states, now), policy[torch.arange(3).unsqueeze(1), step, states])
    mixed = torch.tensor([[0, 3], [1, 2], [2, 0]])  # copies may be at different steps
    assert torch.equal(agent.act(states, mixed), policy[torch.arange(3).unsqueeze(1), mixed, states])


def test_at_the_start_every_action_is_tied_and_all_occur(make_problem: Make) -> None:
    problem = make_problem(range(20), states=100, actions=8, window=5)
    agent = FiniteHorizon(ObservedCounts())
    agent.start(problem)
    behaviour, greedy = agent.policies().values()  # nothing is believed that one could plan with
    assert torch.equal(tabulate(behaviour, problem), tabulate(greedy, problem))
    policy = executed(agent)
    assert policy.shape == (20, 5, 100)
    shares = policy[:, 0].flatten().bincount(minlength=8) / 2000
    assert (shares - 1 / 8).abs().max() < 5 * (7 / 64 / 2000) ** 0.5
    assert not torch.equal(policy[0], policy[1])
    alone = FiniteHorizon(ObservedCounts())
    alone.start(make_problem((7,), states=100, actions=8, window=5))
    assert torch.equal(executed(alone)[0], policy[7])


def test_ties_are_drawn_anew_among_the_best_alone(problem: Problem, make_windows: Callable[..., Windows]) -> None:
    # Actions 0 and 2 are tied, within what rounding leaves; nothing that was seen tells them apart.
    reward = torch.tensor([1.0, 0.5, 1.0 - 1e-13], dtype=FLOAT).repeat(3, STATES)
    windows = make_windows(problem, 1)
    still = replace(windows, actions=windows.actions * 0 + 1, next_states=windows.states)
    agent, believed = FiniteHorizon(ObservedCounts()), Believed(reward, reward, CELLS)
    store = filled(problem, still)
    agent.start(problem)
    plans = []
    for _ in range(40):
        agent.improve(store, believed)
        plans.append(executed(agent)[:, -1])
    assert not any(torch.equal(one, following) for one, following in pairwise(plans))
    shares = torch.stack(plans).flatten().bincount(minlength=3) / (40 * 3 * STATES)
    assert shares[1] == 0
    assert abs(float(shares[0]) - 0.5) < 5 * 0.5 / (40 * 3 * STATES) ** 0.5
    found = tables(agent)
    assert torch.equal(found["greedy"], found["behaviour"])  # one draw a plan, for both
    assert torch.equal(tables(agent)["behaviour"], executed(agent))  # looking does not draw


def test_nothing_is_worth_anything_behind_an_end(make_problem: Make) -> None:
    # State 0: action 0 stays, for .1 a step; action 1 ends the episode in state 2, for .3.
    problem = make_problem((0,), states=3, actions=2, window=6)
    stay, leave = (Episode(torch.zeros(n).long(), *rest) for n, rest in ENDINGS)
    windows = Windows.of_episodes([[stay, leave]], torch.tensor([[0.6, 0.3]], dtype=FLOAT))
    reward = torch.tensor([[0.1, 0.3, 0.0, 0.0, 5.0, 5.0]], dtype=FLOAT)  # of state 2, what optimism makes of it
    believed = Believed(reward, reward, Cells(PAIRS, (3, 2)))
    policy = executed(planned(problem, filled(problem, windows), Counts("zero", 0.0), believed))
    assert policy[0, :, 0].tolist() == [0, 0, 0, 0, 0, 1]  # it stays as long as it can, and leaves at the last step
    truncated = replace(windows, terminated=torch.zeros_like(windows.terminated))  # type: ignore[arg-type]
    policy = executed(planned(problem, filled(problem, truncated), Counts("zero", 0.0), believed))
    assert policy[0, :, 0].tolist() == [0, 0, 0, 0, 1, 1]  # where it leaves in time for what may lie behind

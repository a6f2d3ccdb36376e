"""Value iteration on what is believed, and the random policy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from credit.agents.finite_horizon import FiniteHorizon
from credit.agents.planner import Planner
from credit.agents.random import Random
from credit.agents.value_iteration import ValueIteration
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows
from credit.planning.counts import Counts
from credit.planning.solve import NEARLY_ONE, policy_iteration
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Identity
from credit.recovery.mixers import ReferenceOnly
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.rivals.rules import Delayed

Make = Callable[..., Problem]


def planner(problem: Problem, windows: Windows, **parameters: Any) -> tuple[ValueIteration, Recovery]:
    model = LinearModel("ridge", Identity(), Bootstrap(3))
    recovery = Recovery(model, {}, ReferenceOnly(), {"count": Count(2.0)})
    agent = ValueIteration(Counts(), **parameters)
    for part in (recovery, agent):
        part.start(problem)
    store = Store(problem)
    store.append(windows)
    recovery.observe(store)
    agent.improve(store, recovery)
    return agent, recovery


def actions(policy: Policy) -> torch.Tensor:
    """A policy as a table."""
    assert isinstance(policy, TablePolicy)
    return policy.actions


def test_it_acts_by_the_plan_and_is_judged_without_the_bonus(
    make_problem: Make, make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 40)
    agent, recovery = planner(problem, windows)
    counts = Counts()
    counts.start(problem)
    counts.observe(windows)
    found, policies = recovery.belief(), agent.policies()
    assert found is not None
    for name, reward in (("behaviour", found.plan), ("greedy", found.mixed)):
        expected = policy_iteration(counts.probabilities(), reward.view(2, 10, 3)).policy
        assert torch.equal(actions(policies[name]), expected), name
    behaviour = actions(policies["behaviour"])
    assert not torch.equal(behaviour, actions(policies["greedy"]))
    for state in range(10):
        states = torch.full((2, 1), state)
        assert torch.equal(agent.act(states, torch.zeros_like(states))[:, 0], behaviour[:, state])


def test_a_small_discount_is_myopic(make_problem: Make, make_windows: Callable[..., Windows]) -> None:
    problem = make_problem((0, 1))
    agent, recovery = planner(problem, make_windows(problem, 40), discount=1e-9)
    found = recovery.belief()
    assert found is not None
    assert torch.equal(actions(agent.policies()["behaviour"]), found.plan.view(2, 10, 3).argmax(-1))


def test_before_anything_is_known_it_plays_action_zero(make_problem: Make) -> None:
    agent = ValueIteration(Counts())
    agent.start(make_problem((0, 1)))
    assert agent.act(torch.tensor([[3], [4]]), torch.zeros(2, 1).long()).tolist() == [[0], [0]]
    assert list(agent.policies()) == ["behaviour", "greedy"]


class PerStep(CreditAssigner):
    """Given rewards for every step, without a table; those of old steps change where it learns."""

    def __init__(self, table: torch.Tensor, learns: bool) -> None:
        self._values, self._learns, self.times = table, learns, 0

    def start(self, problem: Problem) -> None: ...

    def observe(self, store: Store) -> None:
        self.times += 1

    @property
    def learns(self) -> bool:
        return self._learns

    def rewards(self, windows: Windows) -> torch.Tensor:
        """r(s, a) and something of s' that averages out no more than by chance."""
        factor = self.times if self._learns else 1
        return factor * (self._values.gather(1, windows.pairs(3)) + 0.1 * windows.next_states)


@pytest.mark.parametrize("learns", [False, True])
@pytest.mark.parametrize("kind", [ValueIteration, FiniteHorizon])
def test_without_a_table_cells_are_worth_the_mean_of_their_steps(
    make_problem: Make, make_windows: Callable[..., Windows], kind: type[Planner], learns: bool
) -> None:
    """Rivals give rewards to steps; what was never seen is worth the mean of all."""
    problem = replace(make_problem((0, 1)), episodic=kind is FiniteHorizon)
    values = torch.randn(2, 30, dtype=FLOAT, generator=torch.Generator().manual_seed(3))
    assigner, agent, store = PerStep(values, learns), kind(Counts()), Store(problem)
    agent.start(problem)
    for number in range(3):
        store.append(make_windows(problem, 1 + number, seed=number))
        assigner.observe(store)
        agent.improve(store, assigner)
    windows, rewards = store.windows, assigner.rewards(store.windows)
    expected = torch.zeros(2, 30, dtype=FLOAT)
    for replica in range(2):
        pairs = windows.pairs(3)[replica].tolist()
        assert 0 < len(set(pairs)) < 30  # some were never seen
        for pair in range(30):
            mine = [float(rewards[replica, row]) for row, seen in enumerate(pairs) if seen == pair]
            expected[replica, pair] = sum(mine) / len(mine) if mine else float(rewards[replica].mean())
    assert agent._rewards is not None
    cells, plan, plain = agent._rewards
    torch.testing.assert_close(plan, expected)
    assert cells.axes == ("state", "action")
    assert plain is plan  # there is no optimism
    counts = Counts()
    counts.start(problem)
    counts.observe(windows)
    if kind is ValueIteration:
        best = policy_iteration(counts.probabilities(), expected.view(2, 10, 3), NEARLY_ONE).policy
        assert torch.equal(actions(agent.policies()["greedy"]), best)
    else:
        last, pairs_of = actions(agent.policies()["greedy"])[:, -1], expected.view(2, 10, 3)
        chosen = pairs_of.gather(-1, last.unsqueeze(-1)).squeeze(-1)
        torch.testing.assert_close(chosen, pairs_of.amax(-1))  # in the last step only the reward counts
        assert not torch.equal(chosen, pairs_of.amin(-1))


def test_a_planner_without_tables_goes_on_from_a_state(
    make_problem: Make, make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1))
    values = torch.randn(2, 30, dtype=FLOAT, generator=torch.Generator().manual_seed(3))
    one, other = ValueIteration(Counts()), ValueIteration(Counts())
    for each in (one, other):
        each.start(problem)
    store, assigner = Store(problem), PerStep(values, False)
    for number in range(2):
        store.append(make_windows(problem, 5, seed=number))
        one.improve(store, assigner)
    other.load_state_dict(one.state_dict())
    store.append(make_windows(problem, 5, seed=9))
    for each in (one, other):
        each.improve(store, assigner)
    assert torch.equal(actions(one.executed()), actions(other.executed()))
    assert torch.equal(one._visits, other._visits)
    assert one._visits.sum() == 2 * 15 * 7


def test_random_actions_are_uniform_and_belong_to_the_seed(
    make_problem: Make, make_windows: Callable[..., Windows]
) -> None:
    problem, alone = make_problem(range(20)), make_problem((7,))
    batch, single = Random(), Random()
    batch.start(problem)
    single.start(alone)
    store = Store(problem)
    store.append(make_windows(problem, 1))
    now = torch.zeros(20, 1, dtype=torch.int64)
    drawn = torch.stack([batch.act(now, now) for _ in range(300)])
    assert torch.equal(torch.stack([single.act(now[:1] + 9, now[:1]) for _ in range(300)])[:, 0], drawn[:, 7])
    shares = drawn.flatten().bincount(minlength=3) / 6000
    assert (shares - 1 / 3).abs().max() < 5 * (2 / 9 / 6000) ** 0.5
    batch.improve(store, Delayed())
    table = batch.policies()["behaviour"].probabilities(torch.arange(10), 0)
    assert table is not None
    assert table.shape == (20, 10, 3)
    assert (table == 1 / 3).all()


def test_random_vectors_are_uniform_and_belong_to_the_seed(make_continuous: Make) -> None:
    batch, single = Random(), Random()
    batch.start(make_continuous((0, 7), window=4))
    single.start(make_continuous((7,), window=4))
    found = []
    for lasts in (4, 2, 4):  # rounds of different length
        for step in range(lasts):
            now, states = torch.full((2, 50), step), torch.zeros(2, 50, 4)
            found.append(batch.act(states, now))
            if step < 2:
                assert torch.equal(single.act(states[:1], now[:1])[0], found[-1][1])
        if lasts == 4:
            for step in (2, 3):
                single.act(states[:1], torch.full((1, 50), step))
    drawn = torch.stack(found)
    assert drawn.shape == (10, 2, 50, 2)
    assert drawn.dtype == torch.float32
    assert drawn.abs().max() <= 1
    assert drawn.abs().mean() == pytest.approx(0.5, abs=0.05)
    judged = batch.policies()["behaviour"]
    assert not torch.equal(judged.act(torch.zeros(2, 50, 4), torch.zeros(2, 50).long()), found[0])

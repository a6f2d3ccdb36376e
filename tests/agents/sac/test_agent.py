"""SAC as an agent of the trainer: what it remembers, how it is relabelled, how it acts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.agents.sac.agent import SAC
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.windows import Windows
from credit.rivals.rules import Delayed

MakeProblem = Callable[..., Problem]
Make = Callable[..., Windows]
ROUNDS = [([[5, 3], [2, 4]], [[1.0, 0.0], [0.0, 0.0]]), ([[4], [6]], [[0.0], [1.0]]), ([[1], [2]], [[1.0], [1.0]])]


class Telling(CreditAssigner):
    """The reward of a step is its first number, times how often it was asked."""

    learns = True

    def __init__(self) -> None:
        self.asked = 0

    def start(self, problem: Problem) -> None: ...

    def observe(self, store: Store) -> None: ...

    def rewards(self, windows: Windows) -> Tensor:
        self.asked += 1
        return self.asked * windows.states[..., 0].double()


def small(problem: Problem, **keys: Any) -> SAC:
    sac = SAC(**({"width": 8, "updates": 2, "first_updates": 3, "batch": 8, "n_step": 2} | keys))
    sac.start(problem)
    return sac


def learned(
    make_continuous: MakeProblem, make: Make, seeds: tuple[int, ...] = (0, 1), rounds: int = 3, **keys: Any
) -> tuple[SAC, Store]:
    """SAC after some rounds; what a seed (0 or 1) was given depends on the seed alone."""
    problem = make_continuous(seeds)
    sac, store, assigner = small(problem, **keys), Store(problem), Telling()
    for number, (lengths, labels) in enumerate(ROUNDS[:rounds]):
        parts = [[of[seed] for seed in seeds] for of in (lengths, labels)]
        store.append(make(*parts, seeds, first=10 * number))
        sac.improve(store, assigner)
    return sac, store


def at(step: int, copies: int, replicas: int = 2) -> Tensor:
    """The step of every copy."""
    return torch.full((replicas, copies), step)


def test_all_that_is_remembered_is_relabelled(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    for rounds in (1, 2, 3):
        sac, store = learned(make_continuous, make_trajectories, rounds=rounds, time_cost=0.25)
        whole = store.windows
        for r in range(2):
            count = len(whole) if whole.count is None else int(whole.count[r])
            expected = (rounds * whole.states[r, :count, 0].double() - 0.25).float()
            assert torch.equal(sac.memory.rewards[r, :count], expected)
        assert sac.memory.windows.states.data_ptr() == whole.states.data_ptr()  # nothing is copied


def test_it_may_go_on_for_ever_and_see_numbers() -> None:
    """Windows of one length that follow each other, states that are numbers: sums run from one into the next."""
    space = Problem.vectors(1, 2, 4, (0, 1))
    finite = Problem.finite(5, 2, 4, (0, 1))
    problem = Problem(finite.observation_space, space.action_space, 4, (0, 1), finite.device, episodic=False)
    sac, store = small(problem, prefer="none"), Store(problem)
    generator = torch.Generator().manual_seed(0)
    for _ in range(3):
        path = torch.randint(5, (2, 2, 4), generator=generator)
        force = torch.rand(2, 2, 4, 2, generator=generator) * 2 - 1
        store.append(Windows.of_grid(path, force, path, torch.rand(2, 2, generator=generator).double()))
        sac.improve(store, Delayed())
    batch = sac.memory.sample(500)[0]
    assert (batch.discount > 0).all()
    labels = Delayed().rewards(store.windows).float()
    rows = torch.arange(24)
    two = labels + 0.99 * torch.nn.functional.pad(labels, (0, 1))[:, 1:]
    torch.testing.assert_close(sac.memory.at(rows.expand(2, -1)).returns, two)
    for step in range(9):
        actions = sac.act(torch.randint(5, (2, 1), generator=generator), at(step % 4, 1))
        assert actions.shape == (2, 1, 2)
    values = [policy.act(torch.arange(5).expand(2, -1), at(0, 5)) for policy in sac.policies().values()]
    assert all(len(value[0].unique(dim=0)) == 5 for value in values)  # every state has an action of its own


def test_a_share_of_a_batch_is_of_trajectories_with_the_label_one(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    sac, store = learned(make_continuous, make_trajectories, success_share=0.5)
    batch = sac.memory.sample(400)[0]
    whole = store.windows
    for r in range(2):
        count = len(whole) if whole.count is None else int(whole.count[r])
        own = whole.states[r, :count]
        won = own[whole.to_steps(whole.labels)[r, :count] > 0]
        hits = (batch.observation[r].unsqueeze(1) == won).all(-1).any(-1)
        assert hits[:200].all()
        assert 0 < hits[200:].sum() < 200
        assert {tuple(row) for row in batch.observation[r].tolist()} == {tuple(row) for row in own.tolist()}


def test_labels_that_are_no_bits_are_refused_or_their_best_preferred(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    problem = make_continuous((0,))
    store = Store(problem)
    store.append(make_trajectories([[2, 3, 4]], [[-1.5, 0.25, 2.0]]))
    with pytest.raises(UserError, match=r"agent\.prefer=success.*-1\.5"):
        small(problem).improve(store, Telling())
    sac = small(problem, prefer="top", success_share=1.0)
    sac.improve(store, Telling())
    drawn = {tuple(row) for row in sac.memory.sample(200)[0].observation[0].tolist()}
    assert drawn == {tuple(row) for row in store.windows.states[0, 5:].tolist()}


@pytest.mark.parametrize("first", [1, 2])
def test_a_replica_learns_and_acts_alone_as_in_a_batch(
    make_continuous: MakeProblem, make_trajectories: Make, first: int
) -> None:
    states = torch.randn(6, 4, generator=torch.Generator().manual_seed(0))
    for seed in (0, 1):
        alone, _ = learned(make_continuous, make_trajectories, (seed,))
        both, _ = learned(make_continuous, make_trajectories)
        for copies in (first, 3):
            own = states[:copies].unsqueeze(0)
            side_by_side = own.repeat(2, 1, 1)
            for step in (*range(9), *range(4), 0):  # rounds of different length
                mine = alone.act(own, at(step, copies, 1))
                torch.testing.assert_close(mine[0], both.act(side_by_side, at(step, copies))[seed])
            for name, policy in alone.policies().items():
                mine = policy.act(own, at(0, copies, 1))
                torch.testing.assert_close(mine[0], both.policies()[name].act(side_by_side, at(0, copies))[seed])


def test_acting_depends_on_the_seed(make_continuous: MakeProblem) -> None:
    states = torch.zeros(2, 1, 4)
    first, again, other = (small(make_continuous(seeds)) for seeds in ((1, 2), (1, 2), (3, 4)))
    actions = [torch.stack([sac.act(states, at(step, 1)) for step in range(9)]) for sac in (first, again, other)]
    assert torch.equal(actions[0], actions[1])
    assert not torch.equal(actions[0], actions[2])
    assert not torch.equal(actions[0][:, 0], actions[0][:, 1])
    assert (actions[0].abs() <= 1).all()
    assert len(actions[0].unique(dim=0)) == 9


def test_policies_are_without_noise_and_take_none(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    sac, _ = learned(make_continuous, make_trajectories)
    twin, _ = learned(make_continuous, make_trajectories)
    states = torch.randn(2, 2, 4, generator=torch.Generator().manual_seed(1))
    policies = sac.policies()
    assert policies.keys() == {"behaviour", "averaged"}
    start = {name: policy.act(states, at(0, 2)) for name, policy in policies.items()}
    for step in range(3):
        for name, policy in policies.items():
            assert torch.equal(policy.act(states, at(step, 2)), start[name])
    assert all(value.abs().max() < 1 for value in start.values())
    assert not torch.equal(start["behaviour"], start["averaged"])
    for step in range(3):  # evaluations between do not change what is explored
        policies["behaviour"].act(states, at(step, 2))
        assert torch.equal(sac.act(states, at(step, 2)), twin.act(states, at(step, 2)))


def test_updates_of_a_round_and_what_is_told_of_them(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    for rounds, updates in ((1, 3), (2, 5), (3, 7)):
        sac, _ = learned(make_continuous, make_trajectories, rounds=rounds, policy_delay=1)
        assert sac.count == updates
        told = sac.diagnostics()
        assert {"critic", "actor", "alpha", "q", "entropy", "temperature"} == told.keys()
        assert all(value.shape == (2,) and value.dtype == torch.float64 for value in told.values())
    seldom, _ = learned(make_continuous, make_trajectories, rounds=1, policy_delay=2)  # due at the second of three
    assert all(value.isfinite().all() for value in seldom.diagnostics().values())
    alone, _ = learned(make_continuous, make_trajectories, (0,), update_ratio=0.5)
    assert alone.count == 4 + 2 + 1  # of 8, 4 and 1 new transitions
    with pytest.raises(UserError, match=r"update_ratio=0\.5 with 2 seeds side by side"):
        learned(make_continuous, make_trajectories, update_ratio=0.5)


@pytest.mark.parametrize("network", ["actor", "critic"])
def test_a_weight_that_is_no_number_stops(make_continuous: MakeProblem, make_trajectories: Make, network: str) -> None:
    sac, store = learned(make_continuous, make_trajectories, rounds=1, policy_delay=9)  # no update of the actor
    getattr(sac, network).blocks[0][-1].fill_(torch.nan)
    store.append(make_trajectories(*ROUNDS[1]))
    with pytest.raises(RunError, match=rf"SAC: a weight of the {network} of seed 1 is not finite after 5 updates"):
        sac.improve(store, Telling())


def test_a_reward_that_is_no_number_stops(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    class Broken(Telling):
        def rewards(self, windows: Windows) -> Tensor:
            found = super().rewards(windows)
            found[1] = torch.nan
            return found

    problem = make_continuous((3, 4))
    sac, store = small(problem), Store(problem)
    store.append(make_trajectories(*ROUNDS[0]))
    with pytest.raises(RunError, match="of seed 4 is not finite after 3 updates; are the rewards finite"):
        sac.improve(store, Broken())

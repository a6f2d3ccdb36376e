"""SAC as an optimizer of the trainer: what it remembers, how it is relabelled, how it acts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from credit.core.interfaces import CreditAssigner
from credit.core.trajectories import ContinuousProblem, Trajectories, TrajectoryDataset
from torch import Tensor

from credit.agents.sac.optimizer import SAC
from credit.core.errors import RunError, UserError

MakeProblem = Callable[..., ContinuousProblem]
Make = Callable[..., Trajectories]
ROUNDS = [([[5, 3], [2, 4]], [[1.0, 0.0], [0.0, 0.0]]), ([[4], [6]], [[0.0], [1.0]]), ([[1], [2]], [[1.0], [1.0]])]
REWARD = ("next", "reward")


class Telling(CreditAssigner):
    """The reward of a step is its first number, times how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def start(self, problem: ContinuousProblem) -> None: ...

    def observe(self, dataset: TrajectoryDataset) -> None: ...

    def rewards(self, windows: Trajectories) -> Tensor:
        self.asked += 1
        return self.asked * windows.states[:, 0].double()


def small(problem: ContinuousProblem, **keys: Any) -> SAC:
    sac = SAC(**({"width": 8, "updates": 2, "first_updates": 3, "batch": 8, "n_step": 2} | keys))
    sac.start(problem)
    return sac


def learned(
    make_continuous: MakeProblem, make: Make, seeds: tuple[int, ...] = (0, 1), rounds: int = 3, **keys: Any
) -> tuple[SAC, TrajectoryDataset]:
    """SAC after some rounds; what a seed (0 or 1) was given depends on the seed alone."""
    problem = make_continuous(seeds)
    sac, dataset, assigner = small(problem, **keys), TrajectoryDataset(problem), Telling()
    for number, (lengths, labels) in enumerate(ROUNDS[:rounds]):
        parts = [[of[seed] for seed in seeds] for of in (lengths, labels)]
        dataset.append(make(*parts, seeds, first=10 * number))
        sac.improve(dataset, assigner)
    return sac, dataset


def test_all_that_is_remembered_is_relabelled_in_place(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    for rounds in (1, 2, 3):
        sac, dataset = learned(make_continuous, make_trajectories, rounds=rounds, time_cost=0.25)
        whole, stored = dataset.windows, sac.memory.buffer[:]
        assert len(sac.memory) == len(whole) < sac.memory.capacity  # part-full: an assignment would change a copy
        assert torch.equal(stored[REWARD][:, 0], (rounds * whole.states[:, 0].double() - 0.25).float())
        for key, values in (
            ("observation", whole.states),
            ("action", whole.actions),
            (("next", "observation"), whole.next_states),
            ("replica", whole.replica),
            (("next", "done"), whole.final),
            (("next", "terminated"), whole.terminated),
            (("next", "truncated"), whole.final & ~whole.terminated),
            (("next", "success"), whole.to_steps(whole.labels) > 0),
        ):
            assert torch.equal(stored[key].view(values.shape), values), key


def test_trajectories_have_ids_of_their_own(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    sac, _ = learned(make_continuous, make_trajectories)
    ids, lengths = torch.unique_consecutive(sac.memory.rows["collector", "traj_ids"], return_counts=True)
    assert lengths.tolist() == [5, 3, 2, 4, 4, 6, 1, 2]  # in the order in which they came
    assert sorted(ids.tolist()) == list(range(8))


def test_room_that_grows_keeps_rows_and_streams(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    sac, dataset = learned(make_continuous, make_trajectories, rounds=1)
    roomy, _ = learned(make_continuous, make_trajectories, rounds=1)
    capacity = sac.memory.capacity
    roomy.memory.reserve(10_000)
    for number in range(1, 5):
        dataset.append(make_trajectories([[9], [7]], [[1.0], [0.0]], first=50 * number))
        for learner in (sac, roomy):
            learner.improve(dataset, Telling())
    assert sac.memory.capacity > capacity
    assert roomy.memory.capacity == 10_000
    assert torch.equal(sac.memory.rows["observation"], dataset.windows.states)
    assert torch.equal(sac.actor.flat, roomy.actor.flat)  # the same batches were drawn


def test_a_share_of_a_batch_is_of_trajectories_with_a_positive_label(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    sac, dataset = learned(make_continuous, make_trajectories, success_share=0.5)
    batch = sac.memory.sample(400)[0]
    whole = dataset.windows
    for r in range(2):
        won = whole.states[(whole.replica == r) & (whole.to_steps(whole.labels) > 0)]
        hits = (batch.observation[r].unsqueeze(1) == won).all(-1).any(-1)
        assert hits[:200].all()
        assert 0 < hits[200:].sum() < 200
        found = {tuple(row) for row in batch.observation[r].tolist()}
        assert found == {tuple(row) for row in whole.states[whole.replica == r].tolist()}


@pytest.mark.parametrize("first", [1, 2])
def test_a_replica_learns_and_acts_alone_as_in_a_batch(
    make_continuous: MakeProblem, make_trajectories: Make, first: int
) -> None:
    states = torch.randn(6, 4, generator=torch.Generator().manual_seed(0))
    for seed in (0, 1):
        alone, _ = learned(make_continuous, make_trajectories, (seed,))
        both, _ = learned(make_continuous, make_trajectories)
        for copies in (first, 3):
            own = states[:copies]
            side_by_side = own.repeat(2, 1)
            for step in (*range(9), *range(4), 0):  # rounds of different length
                mine = slice(copies * seed, copies * (seed + 1))
                torch.testing.assert_close(alone.act(own, step), both.act(side_by_side, step)[mine])
            for name, policy in alone.policies().items():
                torch.testing.assert_close(policy(own, 0), both.policies()[name](side_by_side, 0)[mine])


def test_acting_depends_on_the_seed(make_continuous: MakeProblem) -> None:
    states = torch.zeros(2, 4)
    first, again, other = (small(make_continuous(seeds)) for seeds in ((1, 2), (1, 2), (3, 4)))
    actions = [torch.stack([sac.act(states, step) for step in range(9)]) for sac in (first, again, other)]
    assert torch.equal(actions[0], actions[1])
    assert not torch.equal(actions[0], actions[2])
    assert not torch.equal(actions[0][:, 0], actions[0][:, 1])
    assert (actions[0].abs() <= 1).all()
    assert len(actions[0].unique(dim=0)) == 9


def test_policies_are_without_noise_and_take_none(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    sac, _ = learned(make_continuous, make_trajectories)
    twin, _ = learned(make_continuous, make_trajectories)
    states = torch.randn(4, 4, generator=torch.Generator().manual_seed(1))
    policies = sac.policies()
    assert policies.keys() == {"behaviour", "averaged"}
    for step in range(3):
        for policy in policies.values():
            assert torch.equal(policy(states, step), policy(states, 0))
            assert policy(states, step).abs().max() < 1
    assert not torch.equal(policies["behaviour"](states, 0), policies["averaged"](states, 0))
    for step in range(3):  # evaluations between do not change what is explored
        policies["behaviour"](states, step)
        assert torch.equal(sac.act(states, step), twin.act(states, step))


def test_updates_of_a_round_and_what_is_told_of_them(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    for rounds, updates in ((1, 3), (2, 5), (3, 7)):
        sac, _ = learned(make_continuous, make_trajectories, rounds=rounds, policy_delay=1)
        assert sac.count == updates
        told = sac.diagnostics()
        assert {"critic", "actor", "alpha", "q", "entropy", "temperature"} == told.keys()
        assert all(value.shape == (2,) and value.dtype == torch.float64 for value in told.values())
    alone, _ = learned(make_continuous, make_trajectories, (0,), update_ratio=0.5)
    assert alone.count == 4 + 2 + 1  # of 8, 4 and 1 new transitions
    with pytest.raises(UserError, match=r"update_ratio=0\.5 with 2 seeds side by side"):
        learned(make_continuous, make_trajectories, update_ratio=0.5)


@pytest.mark.parametrize("network", ["actor", "critic"])
def test_a_weight_that_is_no_number_stops(make_continuous: MakeProblem, make_trajectories: Make, network: str) -> None:
    sac, dataset = learned(make_continuous, make_trajectories, rounds=1, policy_delay=9)  # no update of the actor
    getattr(sac, network).blocks[0][-1].fill_(torch.nan)
    dataset.append(make_trajectories(*ROUNDS[1]))
    with pytest.raises(RunError, match=rf"SAC: a weight of the {network} of seed 1 is not finite after 5 updates"):
        sac.improve(dataset, Telling())


def test_a_reward_that_is_no_number_stops(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    class Broken(Telling):
        def rewards(self, windows: Trajectories) -> Tensor:
            return torch.where(windows.replica == 1, torch.nan, super().rewards(windows))

    problem = make_continuous((3, 4))
    sac, dataset = small(problem), TrajectoryDataset(problem)
    dataset.append(make_trajectories(*ROUNDS[0]))
    with pytest.raises(RunError, match="of seed 4 is not finite after 3 updates; are the rewards finite"):
        sac.improve(dataset, Broken())

"""Replays that relabel a share of their rows, or what is sampled, against one that relabels all."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import CreditAssigner, Relabel
from credit.core.store import Store
from credit.core.windows import Windows
from credit.data.relabel import needed, numbers, oldest
from credit.data.replay import Batch, Replay

MakeRagged = Callable[..., Windows]
LENGTHS = [[[7, 3, 1, 5], [2, 4, 4, 1]], [[2, 2], [6, 3]], [[1, 4], [5, 5]]]


class Refitted(CreditAssigner):
    """Rewards that every fit changes: the row's number, and a tenth for each fit."""

    def __init__(self, relabel: Relabel) -> None:
        self.relabel, self.fits, self.asked = relabel, 0, list[list[int]]()

    def start(self, problem: Problem) -> None: ...

    def observe(self, store: Store) -> None:
        self.fits += 1

    @property
    def learns(self) -> bool:
        return True

    def rewards(self, windows: Windows) -> Tensor:
        return self._of(torch.arange(len(windows)).expand(2, -1))

    def at(self, rows: Tensor) -> Tensor:
        self.asked += rows.tolist()
        return self._of(rows)

    def _of(self, rows: Tensor) -> Tensor:
        return torch.sin(rows.double() + 1) + self.fits / 10


def rounds(make: MakeRagged, replay: Replay, assigner: Refitted, problem: Problem, sizes: Sequence[int]) -> list[Batch]:
    """What is drawn after each round."""
    store, found = Store(problem), list[Batch]()
    for lengths, size in zip(LENGTHS, sizes, strict=True):
        store.append(make(lengths, first=len(store), labels=[[float(k) for k in range(len(own))] for own in lengths]))
        assigner.observe(store)
        replay.update(store, assigner, cost=0.5)
        found += replay.sample(size, 2)
    return found


@pytest.mark.parametrize("n_step", [1, 3])
@pytest.mark.parametrize("outcome", [False, True])
def test_what_is_sampled_is_what_the_models_say_now(
    make_trajectories: MakeRagged, make_continuous: Callable[..., Problem], n_step: int, outcome: bool
) -> None:
    problem = make_continuous(window=7, seeds=(3, 4))
    every, some = (Refitted(relabel) for relabel in ("all", "sampled"))
    kept = [Replay(problem, n_step, 0.9, capacity=5, outcome=outcome, kind=torch.float64) for _ in range(2)]
    batches = [
        rounds(make_trajectories, replay, one, problem, (4, 40, 2))
        for replay, one in zip(kept, (every, some), strict=True)
    ]
    for wanted, found in zip(*batches, strict=True):
        for name in ("observation", "returns", "discount", "ahead", "outcome"):
            one, other = getattr(wanted, name), getattr(found, name)
            assert (one is None and other is None) or torch.equal(one, other), name
        assert (found.low >= wanted.low).all()
        assert (found.high <= wanted.high).all()
    assert torch.equal(batches[0][3].high, batches[1][3].high)  # where all of them were drawn
    last = some.asked[-2:]
    assert max(len(set(own)) for own in last) < len(kept[1].windows)  # and not all were asked for in the end


@pytest.mark.parametrize("share", [0.01, 0.3])
def test_a_share_of_the_oldest_is_relabelled_and_all_that_is_new(
    make_trajectories: MakeRagged, make_continuous: Callable[..., Problem], share: float
) -> None:
    problem = make_continuous(window=7, seeds=(3, 4))
    assigner, replay, store = Refitted(share), Replay(problem, kind=torch.float64), Store(problem)
    labelled: list[dict[int, int]] = [{}, {}]  # row → the fit of its reward
    for fit, lengths in enumerate(LENGTHS, 1):
        store.append(make_trajectories(lengths, first=10 * fit, labels=[[0.0] * len(own) for own in lengths]))
        if fit == 3:  # gone on with
            again = Replay(problem, kind=torch.float64)
            again.load_state_dict(replay.state_dict())
            replay = again
        assigner.observe(store)
        replay.update(store, assigner)
        ends = store.windows.ends[:, -1] + 1
        for replica, own in enumerate(labelled):
            stale = sorted(own, key=lambda row, own=own: (own[row], row))[: math.ceil(share * len(own))]  # type: ignore
            own |= dict.fromkeys([*stale, *range(len(own), int(ends[replica]))], fit)
            wanted = [math.sin(row + 1) + own[row] / 10 for row in range(len(own))]
            assert replay.rewards[replica, : len(own)].tolist() == pytest.approx(wanted)
    assert {1, 3} <= set(labelled[0].values())


def test_masks_by_hand() -> None:
    ages = torch.tensor([[3, 1, 2, 1, 0], [1, 1, 0, 0, 0]])
    found = oldest(ages, [1, 0], [4, 2], [5, 3], 0.5)
    assert found.tolist() == [[False, True, False, True, True], [True, False, True, False, False]]
    assert numbers(found).tolist() == [[1, 3, 4], [0, 2, 5]]
    mask = needed(torch.tensor([[0, 3], [1, 1]]), torch.tensor([[1, 3], [3, 2]]), torch.tensor([[0], [1]]), found.shape)
    assert mask.tolist() == [[True, True, False, True, False], [False, True, True, True, False]]

"""The replay buffer against lists, part full and overflowing."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.core.streams import generators
from credit.core.types import Problem
from credit.data.replay import Replay, returns

CAPACITY = 6


@pytest.fixture
def problem(make_problem: Callable[..., Problem]) -> Problem:
    return make_problem((4, 9), window=3)


def numbered(first: int, count: int) -> torch.Tensor:
    """A number for every step [2, count, 3]: replica·1000 + window·10 + step."""
    windows = torch.arange(first, first + count).unsqueeze(1) * 10 + torch.arange(3)
    return torch.stack([windows, windows + 1000])


def test_returns_by_hand() -> None:
    assert returns(torch.tensor([[1.0, 2.0, 4.0], [0.0, 0.0, 8.0]]), 0.5).tolist() == [[3, 4, 4], [2, 4, 8]]
    assert returns(torch.tensor([1.0, 2.0, 4.0]), 1.0).tolist() == [7, 6, 4]


@pytest.mark.parametrize("counts", [(2,), (2, 3), (4, 2), (4, 4), (6, 1, 5, 4), (1, 9)], ids=str)
def test_relabelling_reaches_every_step_that_is_stored(problem: Problem, counts: tuple[int, ...]) -> None:
    replay, total = Replay(problem, CAPACITY, batch=40, discount=0.5), 0
    for round_number, count in enumerate(counts):
        new = numbered(total, count)
        replay.extend(new.double() / 7, name=new)
        total += count
        replay.relabel(numbered(0, total).double() + round_number)
        kept = set(range(total)[-CAPACITY:])
        stored = replay.buffer[:]
        assert len(replay.buffer) == len(kept)
        assert {int(name) // 10 for name in stored["name"][:, 0].flatten()} == kept
        assert torch.equal(stored["reward"], stored["name"].double() + round_number)
        assert torch.equal(stored["outcome"], returns(stored["reward"], 0.5))
        for batch in replay.batches(2):
            assert torch.equal(batch["reward"], batch["name"].double() + round_number)


def test_each_replica_draws_its_own_steps_from_its_own_stream(problem: Problem) -> None:
    replay = Replay(problem, CAPACITY, batch=5, discount=1.0)
    replay.extend(numbered(0, 4).double(), name=numbered(0, 4))
    batches = list(replay.batches(3))
    assert len(batches) == 3
    for replica, stream in enumerate(generators(problem.seeds, "replay")):
        for batch in batches:
            assert batch["name"].shape == (2, 5)
            item = (stream.random(5) * 12).astype(int)  # four windows of three steps
            assert batch["name"][replica].tolist() == (replica * 1000 + item // 3 * 10 + item % 3).tolist()

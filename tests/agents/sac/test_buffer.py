"""Replay: relabelling in place, n-step returns against a walk along each trajectory, sampling."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict

from credit.core.errors import UserError
from credit.data.trajectory_replay import Replay

Make = Callable[..., TensorDict]
LENGTHS, WON = [7, 3, 1, 5], [True, False, True, False]


def filled(make_rows: Make, **keys: float) -> Replay:
    """One replica with four trajectories in a buffer that is far from full."""
    replay = Replay(seeds=(0,), capacity=100, **keys)
    rows = make_rows(LENGTHS, WON)
    replay.extend(rows, torch.zeros(len(rows), dtype=torch.int64))
    return replay


def drawn(replay: Replay, batch: int = 4000) -> dict[bytes, list[float]]:
    """Observation → everything else in its row, for rows that occur in one large batch; equal rows must be equal."""
    sample = replay.sample(batch)[0]
    seen: dict[bytes, list[float]] = {}
    for r in range(replay.replicas):
        parts = (sample.action, sample.returns.unsqueeze(-1), sample.discount.unsqueeze(-1), sample.ahead)
        for key, row in zip(sample.observation[r], torch.cat([part[r] for part in parts], -1).tolist(), strict=True):
            assert seen.setdefault(key.numpy().tobytes(), row) == row
    return seen


def test_all_rewards_of_a_part_full_buffer_are_relabelled_in_place(make_rows: Make) -> None:
    replay = filled(make_rows)
    before = replay.rows.clone()
    rewards = torch.arange(16.0) - 5
    drawn(replay)
    replay.relabel(rewards)
    assert torch.equal(replay.rows["next", "reward"][:, 0], rewards)
    assert (replay.rows.exclude(("next", "reward")) == before.exclude(("next", "reward"))).all()
    rows = drawn(replay)
    returns = [rows[state.numpy().tobytes()][2] for state in replay.rows["observation"]]
    assert returns == rewards.tolist()  # what is sampled is new, too
    more = make_rows([4], [True], seed=9, first_id=4)
    replay.extend(more, torch.zeros(4, dtype=torch.int64))
    assert torch.equal(replay.rows["next", "reward"][:, 0], torch.cat([rewards, more["next", "reward"][:, 0]]))
    with pytest.raises(ValueError, match=r"\(16,\) for 20 rows"):
        replay.relabel(rewards)


@pytest.mark.parametrize("n", [1, 3, 50])
def test_n_step_returns(make_rows: Make, n: int) -> None:
    replay = filled(make_rows, n_step=n, discount=0.9)
    found, stored, start = drawn(replay), replay.rows, 0
    for length, won in zip(LENGTHS, WON, strict=True):
        part = stored[start : start + length]
        start += length
        for t in range(length):
            total, last = 0.0, t
            for k in range(n):
                if t + k < length:
                    total, last = total + 0.9**k * part["next", "reward"][t + k].item(), t + k
            bootstrap = 0.0 if won and last == length - 1 else 0.9 ** (last - t + 1)  # a time-out has a value behind it
            expected = [*part["action"][t].tolist(), total, bootstrap, *part["next", "observation"][last].tolist()]
            assert found[part["observation"][t].numpy().tobytes()] == pytest.approx(expected, abs=1e-6)


def test_a_share_comes_from_successful_trajectories(make_rows: Make) -> None:
    """Also where one replica has them and the other does not."""
    replay = Replay(seeds=(0, 1), capacity=200, success_share=0.75)
    both = [make_rows(LENGTHS, WON, seed=0), make_rows([6, 2], [False, False], seed=1)]
    for r, rows in enumerate(both):
        replay.extend(rows, torch.full((len(rows),), r))
    batch = replay.sample(4000)[0]
    won = torch.cat([both[0]["observation"][:7], both[0]["observation"][10:11]])
    hits = (batch.observation.unsqueeze(2) == won).all(-1).any(-1).float()
    assert hits[0, :3000].all()
    assert hits[0, 3000:].mean() == pytest.approx(8 / 16, abs=0.05)
    assert hits[1].sum() == 0
    counts = (batch.observation[1].unsqueeze(1) == both[1]["observation"]).all(-1).sum(0)
    assert counts.sum() == 4000
    assert counts.min() > 400


def test_a_replica_samples_the_same_alone_as_in_a_batch(make_rows: Make) -> None:
    together, alone = Replay((3, 8), 100, success_share=0.5), Replay((8,), 100, success_share=0.5)
    for number in range(2):  # rows of both arrive in turns
        for r, seed in enumerate((3, 8)):
            rows = make_rows([3 + seed, 4], [True, False], seed=seed + 10 * number)
            together.extend(rows, torch.full((len(rows),), r))
            if r:
                alone.extend(rows, torch.zeros(len(rows), dtype=torch.int64))
    for ours, theirs in zip(together.sample(6, 3), alone.sample(6, 3), strict=True):
        for name in ("observation", "action", "ahead"):
            assert torch.equal(getattr(ours, name)[1:], getattr(theirs, name)), name
        for a, b in zip(ours, theirs, strict=True):
            torch.testing.assert_close(a[1:], b)


def test_how_many_batches_are_drawn_at_once_makes_no_difference(make_rows: Make) -> None:
    one, other = filled(make_rows), filled(make_rows)
    parts = one.sample(8, 1) + one.sample(8, 3)
    for a, b in zip(parts, other.sample(8, 4), strict=True):
        assert all(torch.equal(x, y) for x, y in zip(a, b, strict=True))
    assert not torch.equal(parts[0].observation, parts[1].observation)


def test_bounds_of_a_return_contain_zero(make_rows: Make) -> None:
    replay = Replay(seeds=(0, 1), capacity=100, discount=0.5)
    rows = make_rows([2, 2], [True, False])
    replay.extend(rows, torch.tensor([0, 0, 1, 1]))
    replay.relabel(torch.tensor([-3.0, -1.0, -2.0, 4.0]))
    batch = replay.sample(1)[0]
    assert batch.low.tolist() == [[-6.0], [-4.0]]
    assert batch.high.tolist() == [[0.0], [8.0]]


def test_what_cannot_be_stored_or_drawn(make_rows: Make) -> None:
    replay = Replay(seeds=(0, 1), capacity=20)
    rows = make_rows(LENGTHS, WON)
    with pytest.raises(ValueError, match="whole trajectories"):
        replay.extend(rows[:5], torch.zeros(5, dtype=torch.int64))
    replay.extend(rows, torch.zeros(16, dtype=torch.int64))
    with pytest.raises(UserError, match="holds 20 transitions and was given 32"):
        replay.extend(rows, torch.ones(16, dtype=torch.int64))
    with pytest.raises(RuntimeError, match=r"replicas \[1\] have no trajectories"):
        replay.sample(4)

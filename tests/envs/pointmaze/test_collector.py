"""Whole trajectories of different lengths: ours and TorchRL's own collector gather the same rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice

import pytest
import torch
from tensordict import TensorDictBase
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, SliceSampler, TensorDictReplayBuffer

from credit.core.errors import UserError
from credit.envs.pointmaze.collector import IDS, RoundCollector, whole
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.task import Task

Policy = Callable[[TensorDictBase], TensorDictBase]
Make = Callable[[Task, Sequence[float]], Policy]


class Changing:
    """A policy that can be changed between rounds."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def __call__(self, request: TensorDictBase) -> TensorDictBase:
        return self.policy(request)


def trajectories(rows: TensorDictBase) -> list[TensorDictBase]:
    """Rows [N] by id, checked to be contiguous, connected, and done on the last row alone."""
    ids, lengths = torch.unique_consecutive(rows[IDS], return_counts=True)
    assert len(set(ids.tolist())) == len(ids)
    parts = rows.split(lengths.tolist())
    for part in parts:
        assert torch.equal(part["observation"][1:], part["next", "observation"][:-1])
        done = part["next", "done"][:, 0]
        assert done[-1]
        assert not done[:-1].any()
    return list(parts)


def test_both_collectors_gather_the_same_rows(corridor: Task, navigator: Make) -> None:
    strengths = (1.0, 0.0, 0.6, 0.8)
    slow, quick = navigator(corridor, strengths), navigator(corridor, (1.0, 0.9, 0.8, 0.7))

    def env() -> PointMazeEnv:
        return PointMazeEnv(corridor, copies=4, episodes="round", reward="dense")

    ours, theirs, stocked = Changing(slow), Changing(slow), env()
    stock = iter(
        Collector(
            stocked,
            theirs,
            frames_per_batch=4 * corridor.horizon,
            total_frames=-1,
            reset_at_each_iter=True,
            interruptor=stocked,
            trust_policy=True,
            auto_register_policy_transforms=False,
        )
    )
    rounds = iter(RoundCollector(env(), ours, first_id=30))
    counts = []
    for k in range(3):
        mine, batch = next(rounds), next(stock)
        rows = whole(batch)
        assert torch.equal(mine[IDS].unique(), 30 + 4 * k + torch.arange(4))
        assert (mine.exclude("collector") == rows.exclude("collector")).all()
        assert set(mine.keys(True, True)) == set(rows.keys(True, True))
        counts.append([len(part) for part in trajectories(mine)])
        assert counts[-1] == [len(part) for part in trajectories(rows)]
        ours.policy = theirs.policy = quick  # the later rounds are shorter than the collector's buffer
    assert counts[0][1] == corridor.horizon
    assert max(counts[1]) < corridor.horizon
    assert len(set(counts[0])) == 4


def test_labels_and_ends(corridor: Task, navigator: Make) -> None:
    env = PointMazeEnv(corridor, copies=3, episodes="round", reward="hidden")
    rows = next(iter(RoundCollector(env, navigator(corridor, (1.0, 0.0, 0.8)))))
    parts = trajectories(rows)
    assert [part["next", "success"].any().item() for part in parts] == [True, False, True]
    assert [part["next", "terminated"][-1].item() for part in parts] == [True, False, True]
    assert [part["next", "truncated"][-1].item() for part in parts] == [False, True, False]
    assert rows["next", "truncated"].sum() == 1
    assert torch.isnan(rows["next", "reward"]).all()


def test_a_stream_of_torchrl(corridor: Task, navigator: Make) -> None:
    """Without rounds the stock collector puts episodes together that end at different times."""
    collector = Collector(
        PointMazeEnv(corridor, copies=3),
        navigator(corridor, (1.0, 0.0, 0.6)),
        frames_per_batch=30,
        total_frames=-1,
        trajs_per_batch=5,
        traj_format="cat",
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    for batch in islice(collector, 2):
        parts = trajectories(batch)
        assert len(parts) == 5
        assert len({len(part) for part in parts}) > 1


def test_rows_go_into_a_replay_buffer_with_their_ids(corridor: Task, navigator: Make) -> None:
    buffer = TensorDictReplayBuffer(
        storage=LazyTensorStorage(1000),
        sampler=SliceSampler(slice_len=5, traj_key=IDS, strict_length=True),
        batch_size=20,
    )
    env = PointMazeEnv(corridor, copies=3, episodes="round")
    for rows in islice(RoundCollector(env, navigator(corridor, (1.0, 0.0, 0.6))), 2):
        buffer.extend(rows)
    sample = buffer.sample().reshape(4, 5)
    assert (sample[IDS] == sample[IDS][:, :1]).all()
    assert torch.equal(sample["observation"][:, 1:], sample["next", "observation"][:, :-1])


def test_only_rounds(corridor: Task, navigator: Make) -> None:
    with pytest.raises(UserError, match=r"needs PointMazeEnv\(episodes='round'\), not 'stream'"):
        RoundCollector(PointMazeEnv(corridor), navigator(corridor, (1.0,)))

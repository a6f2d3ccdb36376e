"""Whole trajectories of different lengths from TorchRL's own collector."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, SliceSampler, TensorDictReplayBuffer

from credit.envs.feedback import Success
from credit.envs.pointmaze.collector import IDS, whole
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.task import Task

from ..collecting import Follow, begun

MAP = ["11111", "10001", "11111"]  # of the corridor
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


def rounds(corridor: Task, policy: Policy, reward: str = "dense") -> Iterator[TensorDictBase]:
    """The stock collector, a round a batch."""
    purpose = "environment, 4 at once"  # the noise of our own collector
    env = PointMazeEnv(corridor, copies=4, episodes="round", reward=reward, purpose=purpose)  # type: ignore[arg-type]
    return iter(
        Collector(
            env,
            policy,
            frames_per_batch=4 * corridor.horizon,
            total_frames=-1,
            reset_at_each_iter=True,
            interruptor=env,
            trust_policy=True,
            auto_register_policy_transforms=False,
        )
    )


def test_it_gathers_the_rows_of_our_collector(corridor: Task, navigator: Make) -> None:
    strengths = (1.0, 0.0, 0.6, 0.8)
    slow, quick = navigator(corridor, strengths), navigator(corridor, (1.0, 0.9, 0.8, 0.7))
    policy = Changing(slow)

    def act(states: Tensor, step: Tensor) -> Tensor:
        request = TensorDict({"observation": states[0]}, [4])
        return policy(request)["action"].unsqueeze(0)

    env = PointMaze(MAP, (1, 1), (1, 3), successes=0, partials=0, failures=1, primitive="dense")
    ours, _ = begun(env, Success(corridor.horizon))
    stock, counts = rounds(corridor, policy), []
    for _ in range(3):
        found, primitive = ours.collect(Follow(act), 4)
        rows = whole(next(stock))
        for mine, name in ((found.states, "observation"), (found.actions, "action")):
            assert torch.equal(mine[0], rows[name]), name
        assert torch.equal(found.next_states[0], rows["next", "observation"])
        assert torch.equal(primitive[0], rows["next", "reward"][:, 0].double())
        assert torch.equal(found.ended[0], rows["next", "done"][:, 0])
        assert torch.equal(found.terminated[0], rows["next", "terminated"][:, 0])
        counts.append([len(part) for part in trajectories(rows)])
        policy.policy = quick  # the later rounds are shorter than the collector's buffer
    assert counts[0][1] == corridor.horizon
    assert max(counts[1]) < corridor.horizon
    assert len(set(counts[0])) == 4


def test_labels_and_ends(corridor: Task, navigator: Make) -> None:
    rows = whole(next(rounds(corridor, navigator(corridor, (1.0, 0.0, 0.8, 0.9)), "hidden")))
    parts = trajectories(rows)
    assert [part["next", "success"].any().item() for part in parts] == [True, False, True, True]
    assert [part["next", "terminated"][-1].item() for part in parts] == [True, False, True, True]
    assert [part["next", "truncated"][-1].item() for part in parts] == [False, True, False, False]
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
    for batch in islice(rounds(corridor, navigator(corridor, (1.0, 0.0, 0.6, 0.8))), 2):
        buffer.extend(whole(batch))
    sample = buffer.sample().reshape(4, 5)
    assert (sample[IDS] == sample[IDS][:, :1]).all()
    assert torch.equal(sample["observation"][:, 1:], sample["next", "observation"][:, :-1])

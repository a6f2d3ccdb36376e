"""The environment under TorchRL: specs, resets while others go on, seeds, and the two ways to go on after an end."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs.utils import check_env_specs

from credit.core.errors import UserError
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.task import Task

Make = Callable[[Task, Sequence[float]], Callable[[TensorDictBase], TensorDictBase]]


def forces(seed: int, steps: int, balls: int) -> Tensor:
    """Random actions [steps, balls, 2] with a pull to the right that grows with the ball's number."""
    generator = torch.Generator().manual_seed(seed)
    drawn = torch.rand(steps, balls, 2, generator=generator) * 2 - 1
    return (drawn + torch.linspace(0, 1, balls).view(1, balls, 1) * torch.tensor([1.0, 0.0])).clamp(-1, 1)


def played(env: PointMazeEnv, actions: Tensor) -> list[TensorDictBase]:
    """Steps with automatic resets, as a collector takes them."""
    now, steps = env.reset(), []
    for action in actions:
        step, now = env.step_and_maybe_reset(now.set("action", action))
        steps.append(step.clone())
    return steps


@pytest.mark.parametrize("episodes", ["stream", "round"])
@pytest.mark.parametrize("reward", ["sparse", "dense", "hidden"])
def test_specs(medium: Task, episodes: Any, reward: Any) -> None:
    env = PointMazeEnv(medium, seeds=(0, 1), copies=2, episodes=episodes, reward=reward)
    check_env_specs(env)
    assert env.batch_size == (4,)
    assert env.action_spec.shape == (4, 2)
    assert env.observation_spec["observation"].dtype == torch.float32


def test_an_end_resets_that_ball_alone(corridor: Task) -> None:
    env = PointMazeEnv(corridor, copies=4)
    actions = forces(0, 240, 4)
    steps = played(env, actions)
    ends = torch.stack([step["next", "done"][:, 0] for step in steps])
    assert len(ends.nonzero()) > 8
    assert (ends.any(1) & ~ends.all(1)).sum() > 4  # some end while others go on
    for before, after in pairwise(steps):
        done = before["next", "done"][:, 0]
        gone_on, arrived = after["observation"], before["next", "observation"]
        assert torch.equal(gone_on[~done], arrived[~done])
        assert (gone_on[done, 2:] == 0).all()  # at rest at the start
        assert ((gone_on[done, :2] - torch.tensor(corridor.maze.xy(corridor.start))).abs() <= 0.25).all()
        assert not after["done"].any()


def test_what_ends_an_episode(corridor: Task) -> None:
    env = PointMazeEnv(corridor, copies=4)
    length = torch.zeros(4, dtype=torch.int64)
    seen: set[str] = set()
    for step in played(env, forces(1, 300, 4)):
        length += 1
        terminated, truncated, success = (step["next", key][:, 0] for key in ("terminated", "truncated", "success"))
        assert torch.equal(step["next", "done"][:, 0], terminated | truncated)
        assert torch.equal(terminated, success)
        assert torch.equal(truncated, length == corridor.horizon)
        assert torch.equal(step["next", "reward"][:, 0], success.float())
        seen |= {"goal"} if terminated.any() else set()
        seen |= {"time"} if truncated.any() else set()
        length[terminated | truncated] = 0
    assert seen == {"goal", "time"}


def test_a_ball_at_the_goal_with_its_last_step_is_both(corridor: Task) -> None:
    env = PointMazeEnv(corridor, seeds=(3,))
    right = torch.ones(80, 1, 2) * torch.tensor([1.0, 0.0])
    steps = next(t for t, step in enumerate(played(env, right), start=1) if step["next", "terminated"].item())
    tight = Task(corridor.maze, corridor.start, corridor.goal, steps)
    last = played(PointMazeEnv(tight, seeds=(3,)), right[:steps])[-1]
    assert last["next", "terminated"].item()
    assert last["next", "truncated"].item()


@pytest.mark.parametrize("episodes", ["stream", "round"])
def test_a_replica_alone_is_the_replica_in_a_batch(corridor: Task, episodes: Any) -> None:
    seeds, copies = (5, 9, 2), 2
    actions = forces(2, 120, 6)
    together = played(PointMazeEnv(corridor, seeds, copies, episodes=episodes), actions)
    for r, seed in enumerate(seeds):
        rows = slice(2 * r, 2 * r + 2)
        alone = played(PointMazeEnv(corridor, (seed,), copies, episodes=episodes), actions[:, rows])
        for step, single in zip(together, alone, strict=True):
            assert (step[rows] == single).all()
    first = played(PointMazeEnv(corridor, (5,), 1, episodes=episodes), actions[:, :1])
    assert all((step[:1] == single).all() for step, single in zip(together, first, strict=True))


def test_noise_is_of_its_own_for_seed_copy_and_purpose(medium: Task) -> None:
    def places(**arguments: Any) -> Tensor:
        return PointMazeEnv(medium, **arguments).reset()["observation"][:, :2]

    batch = places(seeds=(0, 1), copies=2)
    assert len(torch.unique(batch, dim=0)) == 4
    assert torch.equal(batch, places(seeds=(0, 1), copies=2))
    assert (places(seeds=(0, 1), copies=2, purpose="evaluation") != batch).all()


def test_set_seed_gives_the_replicas_their_seeds(medium: Task) -> None:
    env = PointMazeEnv(medium, seeds=(0, 1), copies=2)
    env.rollout(5)
    env.set_seed(7)
    assert env.seeds == (7, 8)
    assert torch.equal(env.reset()["observation"], PointMazeEnv(medium, (7, 8), 2).reset()["observation"])


def test_a_round_waits_for_the_last_ball(corridor: Task, navigator: Make) -> None:
    env = PointMazeEnv(corridor, copies=3, episodes="round")
    policy = navigator(corridor, (1.0, 0.7, 0.0))
    now, lengths, taken = env.reset(), [0, 0, 0], 0
    while not env.collection_stopped():
        resting = env.resting.copy()
        step, now = env.step_and_maybe_reset(policy(now))
        taken += 1
        for i in np.flatnonzero(resting):
            assert torch.equal(step["observation"][i], step["next", "observation"][i])
            assert not any(
                step["next", key][i].any() for key in ("done", "terminated", "truncated", "success", "reward")
            )
        for i in np.flatnonzero(step["next", "done"][:, 0].numpy()):
            lengths[i] = taken
    assert lengths[0] < lengths[1] < lengths[2] == taken == corridor.horizon
    assert env.balls.elapsed.tolist() == lengths
    again = env.reset()
    assert not env.resting.any()
    assert (again["observation"][:, 0] < -0.7).all()  # all of them, at the start


def test_the_noise_of_the_next_round_does_not_depend_on_how_long_this_one_took(corridor: Task, navigator: Make) -> None:
    starts = []
    for strength in ((1.0, 1.0), (0.8, 0.0)):
        env = PointMazeEnv(corridor, copies=2, episodes="round")
        now = env.reset()
        policy = navigator(corridor, strength)
        while not env.collection_stopped():
            _, now = env.step_and_maybe_reset(policy(now))
        starts.append(env.reset()["observation"])
    assert torch.equal(*starts)


def test_rewards(corridor: Task) -> None:
    actions = forces(4, 60, 3)
    steps = {
        kind: played(PointMazeEnv(corridor, copies=3, reward=kind), actions) for kind in ("sparse", "dense", "hidden")
    }
    env = PointMazeEnv(corridor, copies=3)
    env.reset()
    for t, (sparse, dense, hidden) in enumerate(zip(*steps.values(), strict=True)):
        assert torch.isnan(hidden["next", "reward"]).all()
        assert (sparse.exclude(("next", "reward")) == hidden.exclude(("next", "reward"))).all()
        assert (sparse.exclude(("next", "reward")) == dense.exclude(("next", "reward"))).all()
        if t < 20:  # nobody has been reset
            place = dense["next", "observation"][:, :2].double().numpy()
            far = np.sqrt(((place - env.balls.goals) ** 2).sum(-1))
            assert dense["next", "reward"][:, 0].numpy() == pytest.approx(np.exp(-far), abs=1e-6)


def test_one_rollout_of_torchrl(medium: Task, navigator: Make) -> None:
    env = PointMazeEnv(medium, copies=2)
    data = env.rollout(300, navigator(medium, (1.0, 1.0)), break_when_any_done=True)
    assert 150 < data.shape[1] < 300
    assert data["next", "success"][:, -1].any()
    assert not data["next", "done"][:, :-1].any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"copies": 0}, "copies=0: at least one of each"),
        ({"seeds": ()}, "seeds=[], copies=1"),
        ({"reward": "dens"}, "reward='dens' is unknown: did you mean 'dense'"),
        ({"episodes": "rounds"}, "episodes='rounds' is unknown: did you mean 'round'"),
    ],
)
def test_bad_arguments(medium: Task, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=re.escape(message)):
        PointMazeEnv(medium, **arguments)


def test_an_action_that_is_no_number_stops(medium: Task) -> None:
    env = PointMazeEnv(medium, copies=2)
    with pytest.raises(RuntimeError, match="PointMaze 1 got the action"):
        env.step(env.reset().update(TensorDict({"action": torch.tensor([[0.0, 0.0], [torch.nan, 1.0]])}, [2])))

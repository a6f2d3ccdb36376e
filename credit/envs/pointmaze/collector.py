"""Whole trajectories, one of every ball, as flat rows: TorchRL's collector, with a shorter way to the same rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.collectors import Collector
from torchrl.envs.utils import ExplorationType, set_exploration_type

from credit.core.errors import UserError
from credit.envs.pointmaze.env import PointMazeEnv

IDS = ("collector", "traj_ids")
ENDS = ("success", "done", "terminated", "truncated")


class RoundCollector(Collector):
    """A collector whose batches are rounds of `PointMazeEnv(episodes="round")`: one whole trajectory of every ball.

    Rows are flat [sum of L_i], ball after ball: the layout that replay buffers and `SliceSampler` expect. The stock
    collector with `reset_at_each_iter=True, interruptor=env` gathers the same rows (see `whole`), but its bookkeeping
    takes up to a millisecond a step.

    Args:
        env: the balls.
        policy: maps a TensorDict with `observation` [n, 4] to one with `action` [n, 2]. It is asked for the balls that
            rest, too, so that the shape never changes.
        first_id: id of the first trajectory; later rounds count on.
        exploration_type: RANDOM samples actions, DETERMINISTIC takes the mean or mode.
        policy_device: where observations are brought for the policy.

    Raises:
        UserError: an environment that streams.

    Example:
        >>> for batch in RoundCollector(env, actor):
        ...     buffer.extend(batch)
    """

    def __init__(
        self,
        env: PointMazeEnv,
        policy: Callable[[TensorDictBase], TensorDictBase],
        first_id: int = 0,
        exploration_type: ExplorationType = ExplorationType.RANDOM,
        policy_device: torch.device | str = "cpu",
    ) -> None:
        if env.episodes != "round":
            raise UserError(f"RoundCollector needs PointMazeEnv(episodes='round'), not {env.episodes!r}")
        self.next_id = first_id
        super().__init__(
            env,
            policy,
            frames_per_batch=env.batch_size[0] * env.task.horizon,
            total_frames=-1,
            exploration_type=exploration_type,
            policy_device=policy_device,
            trust_policy=True,
            use_buffers=False,
            auto_register_policy_transforms=False,
        )

    @torch.no_grad()
    def rollout(self) -> TensorDictBase:
        """One round [sum of L_i] from a full reset, with the keys of `whole`."""
        env: PointMazeEnv = self.env
        balls = env.balls
        env.reset()
        states, actions = [balls.states.copy()], []
        with set_exploration_type(self.exploration_type):
            while not env.collection_stopped():
                observed = torch.from_numpy(states[-1].astype(np.float32)).to(self.policy_device)
                action = self.policy(TensorDict({"observation": observed}, env.batch_size))["action"].cpu()
                env.push(action.numpy())
                states.append(balls.states.copy())
                actions.append(action)
        path, step = np.stack(states), np.arange(1, len(states))[:, None]  # [T + 1, n, 4], [T, 1]
        last = step == balls.elapsed
        success, truncated = last & balls.reached, last & (step >= env.task.horizon)
        observations = torch.from_numpy(path.astype(np.float32))
        ends = dict(zip(ENDS, (success, success | truncated, success, truncated), strict=True))
        ids = self.next_id + torch.arange(len(balls))
        self.next_id += len(balls)
        rows = TensorDict(
            {
                "observation": observations[:-1],
                "action": torch.stack(actions),
                "next": {
                    "observation": observations[1:],
                    "reward": env.rewards(path[1:], success),
                    **{key: torch.from_numpy(flag).unsqueeze(-1) for key, flag in ends.items()},
                },
                "collector": {"traj_ids": ids.expand(last.shape)},
            },
            last.shape,
        )
        return rows.transpose(0, 1)[torch.from_numpy(step <= balls.elapsed).T]


def whole(batch: TensorDictBase) -> TensorDictBase:
    """The first trajectory of every ball [sum of L_i] in a batch [n, T] of the stock collector, ball after ball.

    What comes after it is another episode, or rest, or, behind an interruption, what the collector's buffer held
    before (its id there is -1).
    """
    ids = batch[IDS]
    keys = ("observation", "action", IDS, *(("next", key) for key in ("observation", "reward", *ENDS)))
    return batch.select(*keys)[ids == ids[:, :1]]

"""Whole trajectories of `PointMazeEnv` from TorchRL's own collectors."""

from __future__ import annotations

from tensordict import TensorDictBase

IDS = ("collector", "traj_ids")
ENDS = ("success", "done", "terminated", "truncated")


def whole(batch: TensorDictBase) -> TensorDictBase:
    """The first trajectory of every ball [sum of L_i] in a batch [n, T] of the stock collector, ball after ball.

    The collector is to have `reset_at_each_iter=True, interruptor=env`, and the environment `episodes="round"`. What
    comes after a trajectory is another episode, or rest, or, behind an interruption, what the collector's buffer held
    before (its id there is -1). Rows are flat, the layout that replay buffers and `SliceSampler` expect.
    """
    ids = batch[IDS]
    keys = ("observation", "action", IDS, *(("next", key) for key in ("observation", "reward", *ENDS)))
    return batch.select(*keys)[ids == ids[:, :1]]

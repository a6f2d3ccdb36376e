"""PointMaze for TorchRL: n balls behind one `EnvBase`, and what collects one whole trajectory from each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from credit.core.errors import UserError, nearest
from credit.envs.pointmaze.physics import Balls, noise
from credit.envs.pointmaze.task import Task

Episodes = Literal["stream", "round"]
Reward = Literal["sparse", "dense", "hidden"]


class PointMazeEnv(EnvBase):
    """n = replicas · copies balls that do the same task, batch size [n]; the last key of a step is `done` [n, 1].

    A ball that reaches its goal ends its episode (`terminated`: no value lies behind it), one that has used up the
    horizon is `truncated` (a value does). Both may hold at once, as in Gymnasium. Where one episode ends while others
    go on, `episodes` says what becomes of that ball:

    - `stream`: the partial reset starts its next episode, as collectors expect.
    - `round`: it rests, unmoved and not done, until all are reset. A round holds one episode of every ball, so no
      sample of K trajectories is biased towards short ones, and the noise that a ball meets in its k-th episode does
      not depend on how long the others take.

    Args:
        task: maze, start, goal, horizon.
        seeds: one a replica. copies: balls a replica; the noise of copy c of a replica depends on (its seed, c) alone.
        episodes: see above.
        reward: what `reward` [n, 1] holds: `sparse` (1 at the goal), `dense` (exp of minus the distance to it), or
            `hidden` (NaN: a learner that touches it shows).
        purpose: balls with another purpose (evaluation) meet other noise.

    Example:
        >>> env = PointMazeEnv(Task(Maze.of("Medium"), (1, 1), (6, 6), 300), seeds=[0], copies=8)
        >>> env.rollout(300)["next", "success"].any()
    """

    batch_locked = True

    def __init__(
        self,
        task: Task,
        seeds: Sequence[int] = (0,),
        copies: int = 1,
        *,
        episodes: Episodes = "stream",
        reward: Reward = "sparse",
        purpose: str = "environment",
    ) -> None:
        if not seeds or copies < 1:
            raise UserError(f"PointMazeEnv with seeds={list(seeds)}, copies={copies}: at least one of each is needed")
        for key, value, valid in (("reward", reward, get_args(Reward)), ("episodes", episodes, get_args(Episodes))):
            if value not in valid:
                raise UserError(f"{key}={value!r} is unknown: {nearest(value, valid)}")
        n = len(seeds) * copies
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([n]))
        self.task, self.seeds, self.copies = task, tuple(seeds), copies
        self.episodes, self.reward, self.purpose = episodes, reward, purpose
        self.balls = Balls(task, noise(self.seeds, copies, purpose))
        self.resting = np.zeros(n, dtype=bool)
        flag = Binary(shape=(n, 1), dtype=torch.bool)
        self.observation_spec = Composite(
            observation=Unbounded(shape=(n, 4), dtype=torch.float32), success=flag, shape=(n,)
        )
        self.action_spec = Bounded(low=-1.0, high=1.0, shape=(n, 2), dtype=torch.float32)
        self.reward_spec = Unbounded(shape=(n, 1), dtype=torch.float32)
        self.done_spec = Composite({key: flag.clone() for key in ("done", "terminated", "truncated")}, shape=(n,))

    def collection_stopped(self) -> bool:
        """Whether every ball has ended its episode of this round: the collector's question after every step."""
        return self.episodes == "round" and bool(self.resting.all())

    def push(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Step the balls that do not rest with actions [n, 2]; return which [n] reach the goal or run out of time."""
        awake = ~self.resting
        self.balls.step(actions, np.flatnonzero(awake).tolist())
        reached = self.balls.reached & awake
        truncated = (self.balls.elapsed >= self.task.horizon) & awake
        if self.episodes == "round":
            self.resting = self.resting | reached | truncated
        return reached, truncated

    def rewards(self, states: np.ndarray, reached: np.ndarray) -> Tensor:
        """The reward [..., n, 1] on arrival in states [..., n, 4], given which of them [..., n] are at the goal."""
        if self.reward == "sparse":
            return _column(reached.astype(np.float32))
        if self.reward == "dense":
            distances = np.linalg.norm(states[..., :2] - self.balls.goals, axis=-1)
            return _column(np.exp(-distances).astype(np.float32))
        return torch.full((*reached.shape, 1), torch.nan)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        reached, truncated = self.push(tensordict["action"].numpy())
        ends = {"done": reached | truncated, "terminated": reached, "truncated": truncated}
        out = self._observed(reached).update({key: _column(flag) for key, flag in ends.items()})
        return out.set("reward", self.rewards(self.balls.states, reached))

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None:
            self.balls.reset()
            self.resting = np.zeros(len(self.balls), dtype=bool)
        elif self.episodes == "stream":
            self.balls.reset(np.flatnonzero(mask.numpy().reshape(-1)).tolist())
        return self._observed(np.zeros(len(self.balls), dtype=bool))

    def _set_seed(self, seed: int | None) -> None:
        """Make replica r the one with seed `seed` + r."""
        self.seeds = tuple((seed or 0) + r for r in range(len(self.seeds)))
        self.balls.noise = noise(self.seeds, self.copies, self.purpose)

    def _observed(self, reached: np.ndarray) -> TensorDict:
        states = torch.from_numpy(self.balls.states.astype(np.float32))
        return TensorDict({"observation": states, "success": _column(reached)}, self.batch_size, device=self.device)


def _column(values: np.ndarray) -> Tensor:
    return torch.from_numpy(values).unsqueeze(-1)

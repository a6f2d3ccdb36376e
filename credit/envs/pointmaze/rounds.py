"""Rounds of whole trajectories, some of each replica, under a policy that is a function of states and the step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import torch
from tensordict import TensorDictBase
from torch import Tensor

from credit.core.interfaces import Act
from credit.core.state import Stateful, pack, unpack
from credit.core.trajectories import ContinuousProblem, Trajectories
from credit.core.types import FLOAT
from credit.envs.pointmaze.collector import RoundCollector
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.task import Task


@dataclass(frozen=True)
class Round:
    """K trajectories of each of R replicas as flat rows, replica after replica.

    Attributes:
        rows: [N] with the keys of a collector's batch. replica, number: of each row [N].
        lengths: L [R, K]. success: whether the goal was reached [R, K]. goals: where they were [R, K, 2].
    """

    rows: TensorDictBase
    replica: Tensor
    number: Tensor
    lengths: Tensor
    success: Tensor
    goals: Tensor

    @property
    def primitive(self) -> Tensor:
        """The environment's reward [N]."""
        return self.rows["next", "reward"][:, 0].to(FLOAT)

    def at_goal(self, horizon: int) -> Tensor:
        """1 at the goal, 0 at all other steps and behind the end, [R, K, H]."""
        steps = torch.arange(horizon)
        return (self.success.unsqueeze(-1) & (steps == self.lengths.unsqueeze(-1) - 1)).to(FLOAT)


class Rounds(Stateful):
    """Balls of their own for one purpose, which run a round at a time.

    Args:
        task: maze, start, goal, horizon. problem: seeds and device. copies: K, trajectories of each replica a round.
        purpose: balls with another purpose meet other noise. primitive: what reward their rows have.
    """

    def __init__(
        self,
        task: Task,
        problem: ContinuousProblem,
        copies: int,
        purpose: str,
        primitive: Literal["sparse", "dense"] = "sparse",
    ) -> None:
        self._shape, self._device = (problem.replicas, copies), problem.device
        self._env = PointMazeEnv(task, problem.seeds, copies, episodes="round", reward=primitive, purpose=purpose)
        self._act: Act = lambda states, step: torch.zeros_like(states[:, :2])  # the collector tries its policy once
        self._step = 0
        self._collector = RoundCollector(self._env, self._policy)

    def state_dict(self) -> dict[str, Any]:
        """Where the noise of the balls stands."""
        return {"noise": pack(self._env.balls.noise, "noise"), "next_id": self._collector.next_id}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with that noise."""
        unpack(state["noise"], self._env.balls.noise, "noise")
        self._collector.next_id = state["next_id"]

    def run(self, act: Act) -> Round:
        """One whole trajectory of each ball."""
        self._act, self._step, first = act, 0, self._collector.next_id
        rows = self._collector.rollout()
        ball = rows["collector", "traj_ids"] - first
        lengths = torch.bincount(ball, minlength=len(self._env.balls))
        last = lengths.cumsum(0) - 1
        success = rows["next", "success"][last, 0]
        goals = torch.from_numpy(self._env.balls.goals.copy()).view(*self._shape, 2)
        copies = self._shape[1]
        return Round(rows, ball // copies, ball % copies, lengths.view(self._shape), success.view(self._shape), goals)

    def _policy(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = self._act(tensordict["observation"].to(self._device), self._step)
        self._step += 1
        return tensordict.set("action", actions)


def trajectories(rows: TensorDictBase, replica: Tensor, number: Tensor, labels: Tensor) -> Trajectories:
    """Rows as labelled trajectories, on the device of their labels [R, K]; their reward is left behind."""
    rows = rows.to(labels.device)
    return Trajectories(
        states=rows["observation"],
        actions=rows["action"],
        next_states=rows["next", "observation"],
        replica=replica.to(labels.device),
        number=number.to(labels.device),
        final=rows["next", "done"][:, 0],
        terminated=rows["next", "terminated"][:, 0],
        labels=labels,
    )

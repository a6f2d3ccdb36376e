"""Rounds of whole trajectories, some of each replica, under a policy that is a function of states and the step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import torch
from tensordict import TensorDictBase
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.seams import Act
from credit.core.state import Stateful, pack, unpack
from credit.core.store import Windows
from credit.envs.pointmaze.collector import RoundCollector
from credit.envs.pointmaze.env import PointMazeEnv
from credit.envs.pointmaze.task import Task


@dataclass(frozen=True)
class Round:
    """K trajectories of each of R replicas as flat rows, replica after replica.

    Attributes:
        rows: [N] with the keys of a collector's batch. lengths: L [R, K].
        success: whether the goal was reached [R, K]. goals: where they were [R, K, 2].
    """

    rows: TensorDictBase
    lengths: Tensor
    success: Tensor
    goals: Tensor

    @property
    def primitive(self) -> Tensor:
        """The environment's reward [R, n]."""
        return by_replica(self.rows["next", "reward"][:, 0].to(FLOAT), self.lengths)

    @property
    def windows(self) -> Windows:
        """The trajectories, not yet labelled."""
        return packed(self.rows, self.lengths)

    def states(self, replica: int) -> Tensor:
        """The states of one replica [n, 4]."""
        counts = self.lengths.sum(1)
        first = int(counts[:replica].sum())
        return self.rows["observation"][first : first + int(counts[replica])]

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
        problem: Problem,
        copies: int,
        purpose: str,
        primitive: Literal["sparse", "dense"] = "sparse",
    ) -> None:
        self._shape, self._device = (problem.replicas, copies), problem.device
        self._env = PointMazeEnv(task, problem.seeds, copies, episodes="round", reward=primitive, purpose=purpose)
        self._act: Act = Still()  # the collector tries its policy once
        self._step = torch.zeros(self._shape, dtype=torch.int64, device=problem.device)
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
        self._act, first = act, self._collector.next_id
        self._step.zero_()
        rows = self._collector.rollout()
        ball = rows["collector", "traj_ids"] - first
        lengths = torch.bincount(ball, minlength=len(self._env.balls))
        last = lengths.cumsum(0) - 1
        success = rows["next", "success"][last, 0]
        goals = torch.from_numpy(self._env.balls.goals.copy()).view(*self._shape, 2)
        return Round(rows, lengths.view(self._shape), success.view(self._shape), goals)

    def _policy(self, tensordict: TensorDictBase) -> TensorDictBase:
        states = tensordict["observation"].to(self._device).unflatten(0, self._shape)
        actions = self._act.act(states, self._step).flatten(0, 1)
        self._step += 1
        return tensordict.set("action", actions)


class Still:
    """Does nothing."""

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """No force [R, K, 2]."""
        return torch.zeros_like(states[..., :2])


def packed(rows: TensorDictBase, lengths: Tensor) -> Windows:
    """Flat rows, trajectory after trajectory and replica after replica, as windows; their reward is left behind.

    Args:
        rows: [N] with the keys of a collector's batch. lengths: L [R, K].
    """
    count = lengths.sum(1)
    step = torch.cat([torch.arange(n) for n in lengths.flatten().tolist()])
    return Windows(
        states=by_replica(rows["observation"], lengths),
        actions=by_replica(rows["action"], lengths),
        next_states=by_replica(rows["next", "observation"], lengths),
        step=by_replica(step, lengths),
        labels=torch.zeros(lengths.shape, dtype=FLOAT),
        last=lengths.cumsum(1) - 1,
        ended=by_replica(rows["next", "done"][:, 0], lengths),
        terminated=by_replica(rows["next", "terminated"][:, 0], lengths),
        count=None if bool((count == count[0]).all()) else count,
    )


def by_replica(values: Tensor, lengths: Tensor) -> Tensor:
    """Flat rows [N, ...] of R replicas, one behind the other, as [R, n, ...], filled up with zeros."""
    return torch.nn.utils.rnn.pad_sequence(values.split(lengths.sum(1).tolist()), batch_first=True)

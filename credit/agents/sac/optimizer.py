"""Soft actor-critic as the policy optimizer of a run."""

from __future__ import annotations

from typing import ClassVar

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from credit.agents.sac.learner import Learner
from credit.agents.sac.policy import Policy
from credit.core.component import Domain, Setting
from credit.core.errors import UserError
from credit.core.interfaces import Act, CreditAssigner, Optimizer
from credit.core.trajectories import ContinuousProblem, Trajectories, TrajectoryDataset
from credit.core.types import FLOAT

DIAGNOSTICS = ("critic", "actor", "alpha", "q", "entropy", "temperature")


class SAC(Learner, Optimizer):  # noqa: D101 - the learner's docstring is its own
    __doc__ = Learner.__doc__
    domain: ClassVar[Domain] = "continuous"
    setting: ClassVar[Setting] = "episodic"
    keeps: ClassVar = (*Learner.keeps, "memory", "_diagnostics")

    def start(self, problem: ContinuousProblem) -> None:
        """Make the networks and an empty replay buffer.

        Raises:
            UserError: `update_ratio` with several replicas.
        """
        if self.update_ratio and problem.replicas > 1:
            raise UserError(
                f"optimizer.update_ratio={self.update_ratio} with {problem.replicas} seeds side by side: they do the "
                "same number of updates, and have different numbers of transitions; set update_ratio=0, or replicas=1"
            )
        self._problem = problem
        self.make(problem.observations, problem.actions, problem.seeds, problem.device)
        self.memory = self.replay(1)
        self._policies: dict[tuple[str, int], Policy] = {}
        unknown = torch.full((problem.replicas,), torch.nan, device=problem.device)
        self._diagnostics = {name: unknown.clone() for name in DIAGNOSTICS}

    def act(self, states: Tensor, step: int) -> Tensor:
        """Sampled actions [n, A] in states [n, O], n = R · copies."""
        return self._act("exploring", states, step)

    def improve(self, dataset: TrajectoryDataset, assigner: CreditAssigner) -> None:
        """Remember the newest trajectories, relabel all that is remembered, and fit."""
        first, new = not len(self.memory), dataset.new
        if len(self.memory) + len(new) > self.memory.capacity:
            self.memory.reserve(2 * (len(self.memory) + len(new)))
        before = len(dataset) - new.labels.shape[1]
        ids = (before + new.number) * len(self.seeds) + new.replica
        self.memory.extend(_rows(new, ids), new.replica)
        self.memory.relabel(assigner.rewards(dataset.windows) - self.time_cost)
        transitions = torch.bincount(new.replica, minlength=len(self.seeds)).tolist()
        self._diagnostics |= self.fit(self.memory, self.round_updates(first, transitions))

    def policies(self) -> dict[str, Act]:
        """The mean action, of the actor as it is and of the average of its weights."""

        def of(name: str) -> Act:
            return lambda states, step: self._act(name, states, step)

        return {"behaviour": of("mean"), "averaged": of("averaged")}

    def diagnostics(self) -> dict[str, Tensor]:
        """Losses, mean target, entropy and temperature of the last update in which each was due."""
        return {name: value.detach().to(FLOAT) for name, value in self._diagnostics.items()}

    def _act(self, name: str, states: Tensor, step: int) -> Tensor:
        copies = len(states) // len(self.seeds)
        if (name, copies) not in self._policies:
            self._policies[name, copies] = self.policy(copies, self._problem.window, averaged=name == "averaged")
        policy = self._policies[name, copies]
        if step == 0:
            policy.restart()
        kind = ExplorationType.RANDOM if name == "exploring" else ExplorationType.DETERMINISTIC
        with set_exploration_type(kind):
            actions: Tensor = policy(TensorDict({"observation": states}, [len(states)]))["action"]
        return actions


def _rows(trajectories: Trajectories, ids: Tensor) -> TensorDict:
    """Trajectories as the replay buffer keeps them, with ids [N]; the reward is filled in by relabelling."""

    def column(values: Tensor) -> Tensor:
        return values.unsqueeze(-1)

    final, terminated = trajectories.final, trajectories.terminated
    return TensorDict(
        {
            "observation": trajectories.states,
            "action": trajectories.actions,
            "next": {
                "observation": trajectories.next_states,
                "reward": torch.full_like(trajectories.states[:, :1], torch.nan),
                "success": column(trajectories.to_steps(trajectories.labels) > 0),
                "done": column(final),
                "terminated": column(terminated),
                "truncated": column(final & ~terminated),
            },
            "collector": {"traj_ids": ids},
        },
        [len(trajectories)],
    )

"""Soft actor-critic as the policy optimizer of a run."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.agents.sac.learner import Learner
from credit.agents.sac.networks import encoded
from credit.agents.sac.policy import Policy as Actor
from credit.core.component import Kind
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Agent, CreditAssigner
from credit.core.store import Store

DIAGNOSTICS = ("critic", "actor", "alpha", "q", "entropy", "temperature")


class SAC(Learner, Agent):  # noqa: D101 - the learner's docstring is its own
    __doc__ = Learner.__doc__
    actions: ClassVar[Kind] = "vector"
    keeps: ClassVar = (*Learner.keeps, "memory", "_diagnostics")
    acts: ClassVar = ("actor", "average")

    def start(self, problem: Problem) -> None:
        """Make the networks and an empty memory.

        Raises:
            UserError: `update_ratio` with several replicas; successes are preferred, and labels are no bits.
        """
        if self.update_ratio and problem.replicas > 1 and not problem.lockstep:
            raise UserError(
                f"agent.update_ratio={self.update_ratio} with {problem.replicas} seeds side by side: they do the "
                "same number of updates, and have different numbers of transitions; set update_ratio=0, replicas=1, or "
                "trainer.steps_per_round, where each takes as many steps"
            )
        self._problem = problem
        self.open_eyes(problem)
        states = problem.states if problem.finite_states else problem.observations
        self.make(states, problem.actions, problem.seeds, problem.device)
        self.memory = self.replay(problem)
        self._policies: dict[tuple[str, int], Actor] = {}
        unknown = torch.full((problem.replicas,), torch.nan, device=problem.device)
        self._diagnostics = {name: unknown.clone() for name in DIAGNOSTICS}

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Sampled actions."""
        return self._act("exploring", states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Relabel all that was seen, and fit."""
        new = store.new
        first = len(new) == len(store.windows)
        self.memory.update(store, assigner, self.time_cost)
        self.look(new)
        transitions = [store.taken] if self._problem.lockstep or new.count is None else new.count.tolist()
        self._diagnostics |= self.fit(self.memory, self.round_updates(first, transitions))

    def policies(self) -> dict[str, Policy]:
        """The mean action, of the actor as it is and of the average of its weights."""
        return {"behaviour": Mean(self, "mean"), "averaged": Mean(self, "averaged")}

    def diagnostics(self) -> dict[str, Tensor]:
        """Losses, mean target, entropy and temperature of the last update in which each was due."""
        return {name: value.detach().to(FLOAT) for name, value in self._diagnostics.items()}

    def _act(self, name: str, states: Tensor, step: Tensor) -> Tensor:
        copies = states.shape[1]
        if (name, copies) not in self._policies:
            ahead = 1 if self._problem.lockstep else self._problem.horizon  # steps that others may not take
            self._policies[name, copies] = self.policy(copies, ahead, averaged=name == "averaged")
        policy = self._policies[name, copies]
        explore = name == "exploring"
        if explore and not self._problem.lockstep and not step.any():
            policy.restart()
        return policy.actions(encoded(self.seen(states), self._states), explore)


class Mean(Policy):
    """The mean actions of a learner's actors.

    Args:
        learner: whose. name: `mean`, or `averaged` for the average of their weights.
    """

    def __init__(self, learner: SAC, name: str) -> None:
        self._learner, self._name = learner, name

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """tanh of the mean [R, K, A]."""
        return self._learner._act(self._name, states, step)

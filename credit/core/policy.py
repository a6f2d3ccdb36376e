"""What an agent follows: actions for observations, and probabilities where it can give them."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem


class Policy(ABC):
    """Maps what K copies of each of R replicas see to what they do."""

    @abstractmethod
    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions [R, K] int64 or [R, K, A] float32.

        Args:
            states: [R, K] int64 or [R, K, O] float32. step: in the episode, or in the window where the task goes on
                for ever [R, K] int64. Copies whose episode is over are asked for, too; nobody looks at the answer.
        """

    def probabilities(self, states: Tensor, step: int) -> Tensor | None:
        """Of every action [R, n, A] in states [n] or [n, O] at one step; None where the policy cannot say."""
        return None


class TablePolicy(Policy):
    """One action for every state, or for every step and state.

    Args:
        actions: [R, S], or [R, T, S] by step.
        count: A.
    """

    def __init__(self, actions: Tensor, count: int) -> None:
        self.actions, self.count = actions, count

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """π(s) or π_t(s)."""
        if self.actions.dim() == 2:
            return self.actions.gather(1, states)
        table = self.actions.flatten(1)
        return table.gather(1, step * self.actions.shape[2] + states)

    def probabilities(self, states: Tensor, step: int) -> Tensor:
        """One for the action, zero for the others."""
        chosen = self.actions if self.actions.dim() == 2 else self.actions[:, step]
        return torch.nn.functional.one_hot(chosen[:, states], self.count).to(FLOAT)


def tabulate(policy: Policy, problem: Problem) -> Tensor | None:
    """A policy of a finite problem as a table, for a judge that knows P and r.

    Returns:
        Actions [R, S] or [R, T, S] where it is a `TablePolicy`; else probabilities [R, T, S, A], one step after the
        other; None where the policy cannot say.
    """
    if type(policy) is TablePolicy:
        return policy.actions
    states = torch.arange(problem.states, device=problem.device)
    found = [policy.probabilities(states, step) for step in range(problem.horizon)]
    return None if any(part is None for part in found) else torch.stack(found, dim=1)  # type: ignore[arg-type]

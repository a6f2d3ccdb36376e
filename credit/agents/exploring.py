"""ε-greedy: now and then a uniform action."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.policy import Policy
from credit.core.streams import Episodes, Stream


def explored(best: Tensor, epsilon: float | Tensor, count: int, numbers: Tensor) -> Tensor:
    """A uniform action among `count` with probability ε, else the best; each copy for itself.

    Args:
        best: [R, K]. numbers: uniform ones, two for each copy [R, K, 2].
    """
    chance, which = numbers.unbind(-1)
    return torch.where(chance < epsilon, (which * count).to(torch.int64), best)


class EpsilonGreedy(Policy):
    """A uniform action with probability ε, else that of another policy.

    Args:
        greedy: the other. epsilon: ε, or that of each replica [R, 1]. count: A.
        stream: the random numbers of the agent that acts so.
    """

    def __init__(self, greedy: Policy, epsilon: float | Tensor, count: int, stream: Stream | Episodes) -> None:
        self.greedy, self.epsilon, self.count, self.stream = greedy, epsilon, count, stream

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions [R, K]."""
        return explored(self.greedy.act(states, step), self.epsilon, self.count, self.stream.rows(step))

    def probabilities(self, states: Tensor, step: int) -> Tensor | None:
        """ε/A for every action, and 1 − ε more for the best [R, n, A]."""
        best = self.greedy.probabilities(states, step)
        epsilon = self.epsilon.unsqueeze(-1) if isinstance(self.epsilon, Tensor) else self.epsilon
        return None if best is None else epsilon / self.count + (1 - epsilon) * best

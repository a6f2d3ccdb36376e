"""What the actors of all replicas do, with and without exploration."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from credit.agents.sac.networks import encoded
from credit.agents.torchrl.heads import Head
from credit.agents.torchrl.learner import Learner
from credit.agents.torchrl.noise import Noise
from credit.core.policy import Policy


class Following(Policy):
    """The actors as they are now, one replica after the other.

    Args:
        learners: R of them. head: what their outputs mean. size: numbers that they see of a state.
        seen: how they see it, [R, n, ...] → the same. noise: what exploration draws; None for the best actions.
    """

    def __init__(
        self,
        learners: Sequence[Learner],
        head: Head,
        size: int,
        seen: Callable[[Tensor], Tensor],
        noise: Noise | None = None,
    ) -> None:
        self._learners, self._head, self._size, self._seen, self._noise = learners, head, size, seen, noise

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions [R, K] or [R, K, A]."""
        raw = self._outputs(encoded(self._seen(states), self._size))
        return self._head.best(raw) if self._noise is None else self._head.explored(raw, self._noise(step))

    def probabilities(self, states: Tensor, step: int) -> Tensor | None:
        """Of every action [R, n, A]; None where they are vectors."""
        raw = self._outputs(encoded(self._seen(states), self._size).expand(len(self._learners), -1, -1))
        return self._head.best_probabilities(raw) if self._noise is None else self._head.probabilities(raw)

    def _outputs(self, seen: Tensor) -> Tensor:
        """[R, n, outputs]."""
        return torch.stack([learner.outputs(own) for learner, own in zip(self._learners, seen, strict=True)])

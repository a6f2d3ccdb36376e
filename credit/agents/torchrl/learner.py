"""One replica: its networks, its loss, and the gradient steps that it takes."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.objectives import SoftUpdate

from credit.agents.torchrl.heads import Head
from credit.agents.torchrl.recipes import Recipe
from credit.agents.torchrl.rows import numbers_seen
from credit.core.checks import require_finite
from credit.core.problem import FLOAT, Problem
from credit.core.state import Stateful
from credit.core.streams import reset_seed
from credit.networks.modules import Network
from credit.networks.seeding import seeded

if TYPE_CHECKING:
    from credit.agents.torchrl.agent import TorchRL


class Learner(Stateful):
    """A loss module of one replica with its optimizer and target networks.

    Networks are in evaluation mode, in gradient steps as elsewhere, as `Replicated` has them: none draws random numbers
    (dropout) or looks at a batch (batch norms, whose running statistics stay as they were made).

    Args:
        recipe: which loss. head: what the actor's outputs mean. agent: its settings. network: what makes networks.
        problem: sizes and device. seed: of the replica.
    """

    keeps: ClassVar = ("loss", "_adam", "updates")

    def __init__(
        self, recipe: Recipe, head: Head, agent: TorchRL, network: Network, problem: Problem, seed: int
    ) -> None:
        self._recipe, self._agent, self.seed, self._device = recipe, agent, seed, problem.device
        seen = numbers_seen(problem)

        def make(inputs: int, outputs: int) -> nn.Module:
            return network.make(inputs, outputs, problem.device).eval()

        with self.random("networks"):
            self._network = make(seen, head.outputs)
            self.loss = recipe.loss(agent, head.actor(self._network), make, seen, problem.actions).to(problem.device)
        self._adam = torch.optim.Adam(self.loss.parameters(), lr=agent.learning_rate)
        self._targets = None if recipe.newest else SoftUpdate(self.loss, tau=agent.tau)
        self.updates = 0

    def random(self, purpose: str, number: int = 0) -> AbstractContextManager[None]:
        """A context in which PyTorch draws the numbers of this replica for a purpose.

        Args:
            purpose: what for. number: how often that was before.
        """
        return seeded(reset_seed(self.seed, f"torchrl/{purpose}", 0, number), self._device)

    @torch.no_grad()
    def outputs(self, states: Tensor) -> Tensor:
        """Of the actor's network [n, outputs] for encoded states [n, O]."""
        values: Tensor = self._network(states)
        return values

    def fit(self, batches: Iterable[TensorDict]) -> dict[str, Tensor]:
        """A gradient step on each batch.

        Returns:
            What the last one that moved the actor came to, each []; nothing where none did.

        Raises:
            RunError: a weight is not finite.
        """
        told = dict[str, Tensor]()
        try:
            for data in batches:
                told = self._step(data) or told
        except (RuntimeError, ValueError):  # distributions refuse what is not finite, in words of their own
            self._require_finite()
            raise
        self._require_finite()
        return told

    def acting(self) -> dict[str, Any]:
        """The actor's weights, without the critics'."""
        mine = {name: weight for name, weight in self.loss.state_dict().items() if name.startswith("actor")}
        return {"loss": ["state", mine]}

    def _step(self, data: TensorDict) -> dict[str, Tensor]:
        self.updates += 1
        told = dict[str, Tensor]()
        if due := self.updates % self._agent.policy_delay == 0:
            terms = self.loss(data)
            told = {name: terms[key].detach().to(FLOAT).mean() for name, key in self._recipe.reports.items()}
            total = sum(value for key, value in terms.items() if key.startswith("loss_"))
        else:
            total, _ = getattr(self.loss, self._recipe.critic)(data)
        self._adam.zero_grad()
        total.backward()
        if self._agent.gradient_clip is not None:
            nn.utils.clip_grad_norm_(self.loss.parameters(), self._agent.gradient_clip)
        self._adam.step()
        if due and self._targets is not None:
            self._targets.step()
        return told

    def _require_finite(self) -> None:
        rate = self._agent.learning_rate
        after = f" after {self.updates} updates; are the rewards finite? else try an agent.learning_rate below {rate}"
        weights = (weight.unsqueeze(0) for weight in self.loss.parameters())
        require_finite(f"agent.loss={self._agent.loss}: a weight", weights, [self.seed], after)

"""Actors side by side as the policy of a collector."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs.utils import ExplorationType, exploration_type

from credit.agents.sac.networks import deviation
from credit.core.draws import Draws
from credit.networks.stack import Stack, Tape


class Policy:
    """Maps `observation` [R·copies, O] to `action` [R·copies, A].

    Actions are sampled where TorchRL's exploration type is RANDOM, and tanh of the mean elsewhere.

    The noise of a whole round is drawn at its start, so that what a replica explores does not depend on how long the
    rounds of the others last.

    Args:
        actor: R networks. draws: where noise comes from. copies: rows a replica. horizon: steps of a round, at most.

    Example:
        >>> policy = sac.policy(copies=5, horizon=300)
        >>> rows = collect(policy)  # one round
        >>> policy.restart()
    """

    def __init__(self, actor: Stack, draws: Draws, copies: int, horizon: int) -> None:
        self.copies, self.horizon = copies, horizon
        self._actor, self._draws = actor, draws
        self._actions = actor.shape.outputs // 2
        self._tape = Tape(actor.shape, actor.members, copies, actor.flat.device)
        self._noise: list[Tensor] = []

    def restart(self) -> None:
        """Begin another round: the rest of this round's noise is dropped."""
        self._noise = []

    def __call__(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Set `action`."""
        explore = exploration_type() == ExplorationType.RANDOM
        return tensordict.set("action", self.actions(tensordict["observation"], explore))

    @torch.no_grad()
    def actions(self, observation: Tensor, explore: bool) -> Tensor:
        """Actions [..., A] for observations [..., O] of R·copies, sampled or tanh of the mean."""
        tape = self._tape
        if torch.compiler.is_exporting():  # there, memory that is kept from call to call cannot be written to
            tape = Tape(self._actor.shape, self._actor.members, self.copies, self._actor.flat.device)
        tape.input.copy_(observation.reshape(tape.input.shape))
        loc, raw = self._actor.forward(tape).chunk(2, -1)
        if explore:
            loc = torch.addcmul(loc, deviation(raw), self._next())
        return loc.tanh().view(*observation.shape[:-1], self._actions)

    def _next(self) -> Tensor:
        if not self._noise:
            drawn = self._draws.normal(self.horizon, self.copies, self._actions, axis=1)
            self._noise = list(drawn.flip(0).unbind())
        return self._noise.pop()

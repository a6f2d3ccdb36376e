"""The losses of soft actor-critic and their gradients, all from the same weights, as TorchRL's `SACLoss` has them."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from credit.agents.sac.networks import CRITICS, Squashed, squash, squash_backward
from credit.data.replay import Batch
from credit.networks.stack import Stack, Tape


class Terms(NamedTuple):
    """What the losses are made of.

    Attributes:
        target: y [R, B]. residual: Q(s, a) − y of both critics [R, 2, B].
        log_prob: log π(ã|s) [R, B] of a sampled action. value: min Q(s, ã) [R, B]. None where the actor was not due.
    """

    target: Tensor
    residual: Tensor
    log_prob: Tensor | None
    value: Tensor | None


def losses(terms: Terms, log_alpha: Tensor, target_entropy: float) -> dict[str, Tensor]:
    """The losses [R].

    `critic` = Σ mean (Q − y)², `actor` = mean (α log π − min Q), `alpha` = −log α·mean(log π + H̄).
    """
    values = {"critic": terms.residual.square().mean(-1).sum(1)}
    if terms.log_prob is not None and terms.value is not None:
        values["actor"] = (log_alpha.exp().unsqueeze(-1) * terms.log_prob - terms.value).mean(-1)
        values["alpha"] = -log_alpha * (terms.log_prob.mean(-1) + target_entropy)
    return values


def entropy_room(discount: float, actions: int, target_entropy: float) -> tuple[float, float]:
    """How far entropy takes a soft return below and above the return, in units of the temperature α.

    A soft value adds α·H(π) for every later state: γ/(1 − γ) of it at most. No policy on [−1, 1]^A has more entropy
    than the uniform one, A·log 2. Downwards no bound holds for every policy, but α keeps the mean entropy at H̄ or
    above; and the best soft policy is never below the bound of the return alone, since the uniform one is not.

    Args:
        discount: γ. actions: A. target_entropy: H̄.
    """
    later = discount / (1 - discount)
    return later * min(target_entropy, 0.0), later * actions * math.log(2)


class Gradients:
    """One pass through actors, critics and targets that leaves the gradients of all losses.

    Args:
        actor, critic, target: networks of R, 2R and 2R members; critic c of replica r is member 2r + c.
        by_actor, by_critic: where the gradients of actor and critics go. by_log_alpha: and that by log α [R].
        target_entropy: H̄. room: what entropy adds to the bounds of a return (`entropy_room`), where targets are to be
            kept within them; None where they are not.
    """

    def __init__(
        self,
        actor: Stack,
        critic: Stack,
        target: Stack,
        by_actor: Stack,
        by_critic: Stack,
        by_log_alpha: Tensor,
        target_entropy: float,
        room: tuple[float, float] | None,
    ) -> None:
        self.actor, self.critic, self.target = actor, critic, target
        self.by_actor, self.by_critic, self.by_log_alpha = by_actor, by_critic, by_log_alpha
        self.target_entropy, self.room = target_entropy, room
        self._tapes: dict[tuple[Stack, int], Tape] = {}

    def __call__(self, batch: Batch, noise: Tensor, log_alpha: Tensor, actor_due: bool = True) -> Terms:
        """Fill the gradients.

        Args:
            batch: transitions. noise: standard normal ε [2, R, B, A], for ã at s and for the action at s′.
            log_alpha: log α [R]. actor_due: whether gradients of actor and α are wanted.
        """
        rows, alpha = batch.returns.shape[1], log_alpha.exp().unsqueeze(-1)
        y = self._targets(batch, noise[1], alpha)
        log_prob, value = self._actor(batch.observation, noise[0], alpha) if actor_due else (None, None)
        q, tape = self._values(self.critic, batch.observation, batch.action)
        residual = q - y.unsqueeze(1)
        self.critic.backward(tape, (residual * (2 / rows)).view(-1, rows, 1), self.by_critic)
        return Terms(y, residual, log_prob, value)

    def _actor(self, observation: Tensor, noise: Tensor, alpha: Tensor) -> tuple[Tensor, Tensor]:
        """Fill the gradients of actor and α; log π(ã|s) and min Q(s, ã) [R, B]."""
        rows, width = observation.shape[1:]
        sampled, acting = self._act(observation, noise)
        q, tape = self._values(self.critic, observation, sampled.action)
        value = q.amin(1)
        by_q = (q == value.unsqueeze(1)) * (-1 / rows)  # only the lesser of both critics counts
        through = self.critic.backward(tape, by_q.view(-1, rows, 1), None)
        by_action = torch.bmm(through, self.critic.layers[0].weight[..., width:])
        by_action = torch.add(*by_action.view(-1, CRITICS, *noise.shape[1:]).unbind(1))
        by_output = squash_backward(sampled, noise, by_action, (alpha / rows).unsqueeze(-1))
        self.actor.backward(acting, by_output, self.by_actor)
        torch.sub(-self.target_entropy, sampled.log_prob.mean(-1), out=self.by_log_alpha)
        return sampled.log_prob, value

    def _targets(self, batch: Batch, noise: Tensor, alpha: Tensor) -> Tensor:
        """y = returns + γⁿ (min Q̄(s′, a′) − α log π(a′|s′)) [R, B]."""
        following, _ = self._act(batch.ahead, noise)
        q, _ = self._values(self.target, batch.ahead, following.action)
        soft = torch.addcmul(q.amin(1), alpha, following.log_prob, value=-1)
        y = torch.addcmul(batch.returns, batch.discount, soft)
        if self.room is None:
            return y
        low, high = batch.low + self.room[0] * alpha, batch.high + self.room[1] * alpha
        return torch.minimum(torch.maximum(y, low), high)

    def _act(self, observation: Tensor, noise: Tensor) -> tuple[Squashed, Tape]:
        tape = self._tape(self.actor, observation.shape[1])
        tape.input.copy_(observation)
        return squash(self.actor.forward(tape), noise), tape

    def _values(self, critic: Stack, observation: Tensor, action: Tensor) -> tuple[Tensor, Tape]:
        """Q [R, 2, B]; critics and targets are never needed at once, and share their memory."""
        tape = self._tape(self.critic, observation.shape[1])
        x = tape.input.view(-1, CRITICS, *tape.input.shape[1:])
        x.copy_(torch.cat([observation, action], -1).unsqueeze(1))
        return critic.forward(tape).view(-1, CRITICS, observation.shape[1]), tape

    def _tape(self, stack: Stack, rows: int) -> Tape:
        if (stack, rows) not in self._tapes:
            self._tapes[stack, rows] = Tape(stack.shape, stack.members, rows, stack.flat.device)
        return self._tapes[stack, rows]


class Compiled:
    """`Gradients` by way of `torch.compile`, which wants a function that changes nothing it is given.

    Args:
        gradients: what would do the same without.
    """

    def __init__(self, gradients: Gradients) -> None:
        self._gradients = gradients
        self._pure = torch.compile(self._fresh, fullgraph=True)

    def __call__(self, batch: Batch, noise: Tensor, log_alpha: Tensor, actor_due: bool = True) -> Terms:
        """Fill the gradients."""
        given = self._gradients
        weights = (given.actor.flat, given.critic.flat, given.target.flat)
        terms, by_critic, by_actor, by_log_alpha = self._pure(weights, batch, noise, log_alpha, actor_due)
        torch._foreach_copy_(given.by_critic.blocks, by_critic)
        if actor_due:
            torch._foreach_copy_(given.by_actor.blocks, by_actor)
            given.by_log_alpha.copy_(by_log_alpha)
        return terms

    def _fresh(
        self, weights: tuple[Tensor, Tensor, Tensor], batch: Batch, noise: Tensor, log_alpha: Tensor, actor_due: bool
    ) -> tuple[Terms, list[Tensor], list[Tensor], Tensor]:
        given = self._gradients
        stacks = zip((given.actor, given.critic, given.target), weights, strict=True)
        actor, critic, target = (Stack(stack.shape, stack.members, flat) for stack, flat in stacks)
        by_actor, by_critic, by_log_alpha = actor.apart(), critic.apart(), torch.empty_like(log_alpha)
        run = Gradients(actor, critic, target, by_actor, by_critic, by_log_alpha, given.target_entropy, given.room)
        terms = run(batch, noise, log_alpha, actor_due)
        return terms, by_critic.blocks, by_actor.blocks if actor_due else [], by_log_alpha

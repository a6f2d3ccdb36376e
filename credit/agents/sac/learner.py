"""Soft actor-critic: R learners side by side, each with its own data, weights and random numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

import torch
from annotated_types import Interval
from torch import Tensor

from credit.agents.sac.loss import Compiled, Gradients, Terms, entropy_room, losses
from credit.agents.sac.networks import CRITICS, encoded
from credit.agents.sac.policy import Policy
from credit.agents.seeing import Seeing
from credit.core.checks import require_finite
from credit.core.component import ranged
from credit.core.draws import Draws
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.ranges import NonNegative, Positive, PositiveInt, Probability
from credit.core.seams import Encoder
from credit.core.streams import generators
from credit.data.preferred import Prefer
from credit.data.replay import Batch, Replay
from credit.networks.adam import Adam, step
from credit.networks.denormals import flushed
from credit.networks.stack import Shape, Stack, Tape, padded

BLOCK = 32  # batches drawn at once

Rate = Annotated[float, Interval(gt=0, le=1)]


class Learner(Seeing):
    """Soft actor-critic with twin critics (B.2, line 13), on steps whose rewards may change from round to round.

    Actions are vectors in [−1, 1], states vectors, or numbers (seen one-hot). The defaults are the recipe `stable`; the
    paper's plain SAC is `layer_norm=False, updates=600, first_updates=1500, batch=128, policy_delay=1, n_step=1,
    success_share=0, target_clip=False`.

    Args:
        width: of the hidden layers of actor and critics. depth: how many of them.
        layer_norm: whether critics have layer norms.
        learning_rate: Adam's, of actor, critics and α. discount: γ. target_rate: τ, at which the targets follow.
        updates: gradient updates a round. first_updates: in the first round, on what was there before.
        update_ratio: updates a new transition; 0 leaves it to `updates`.
        batch: B, transitions an update. policy_delay: updates of the critics for one of actor and α.
        n_step: n, steps of reward before the target's bootstrap. The entropy within them is left out.
        success_share: of a batch, what is drawn from preferred windows.
        prefer: which those are: of labels that are bits the successes, the `top` tenth of any others, or `none`.
        target_clip: whether targets stay within what the stored rewards and entropy allow (`entropy_room`).
        average_rate: at which the average of the actor's weights, for evaluation only, follows them.
        temperature: α at the start. adapt_temperature: whether it is adapted to the target entropy.
        target_entropy: H̄; None is minus the number of actions.
        time_cost: what every step costs: subtracted from every reward.
        compile: whether `torch.compile` gets the update, after half a minute; wants a C++ compiler on a CPU.
        encoder: how the networks see a vector; None for as it is.

    Example: on transitions of one's own, one seed, every window an episode.
        >>> problem = Problem.vectors(4, 2, window=300, seeds=(0,))
        >>> windows = Windows.of_episodes([[Episode(states, actions, next_states, terminated=True)]], labels)
        >>> learner = Learner(width=64)
        >>> learner.make(observations=4, actions=2, seeds=(0,))
        >>> replay = learner.replay(problem)
        >>> replay.relabel(windows, rewards)  # [1, n]
        >>> learner.fit(replay, 1000)
        >>> learner.mean(states.unsqueeze(0))  # what it would do now [1, n, 2]
    """

    keeps: ClassVar[tuple[str, ...]] = (
        *("actor", "average", "critic", "target", "log_alpha", "_adam", "_critic_adam"),
        *("_noise", "_exploration", "count"),
    )

    @ranged
    def __init__(
        self,
        width: PositiveInt = 64,
        depth: PositiveInt = 2,
        layer_norm: bool = True,
        learning_rate: Positive = 1e-3,
        discount: Annotated[float, Interval(ge=0, lt=1)] = 0.99,
        target_rate: Rate = 0.005,
        updates: PositiveInt = 1200,
        first_updates: PositiveInt = 3000,
        update_ratio: NonNegative = 0.0,
        batch: PositiveInt = 256,
        policy_delay: PositiveInt = 2,
        n_step: PositiveInt = 30,
        success_share: Probability = 0.5,
        prefer: Prefer = "success",
        target_clip: bool = True,
        average_rate: Rate = 0.005,
        temperature: Positive = 1.0,
        adapt_temperature: bool = True,
        target_entropy: float | None = None,
        time_cost: NonNegative = 0.0,
        compile: bool = False,
        encoder: Encoder | None = None,
    ) -> None:
        self.width, self.depth, self.layer_norm = width, depth, layer_norm
        self.learning_rate, self.discount, self.target_rate = learning_rate, discount, target_rate
        self.updates, self.first_updates, self.update_ratio = updates, first_updates, update_ratio
        self.batch, self.policy_delay, self.n_step = batch, policy_delay, n_step
        self.success_share, self.prefer, self.target_clip = success_share, prefer, target_clip
        self.average_rate = average_rate
        self.temperature, self.adapt_temperature = temperature, adapt_temperature
        self.target_entropy = target_entropy
        self.time_cost, self.compile = time_cost, compile
        self.encoder = encoder

    def make(self, observations: int, actions: int, seeds: Sequence[int], device: torch.device | str = "cpu") -> None:
        """Make the networks of R seeds.

        Args:
            observations: numbers in a state, or how many states there are where they are numbers. actions: numbers in
                an action. seeds: one a replica. device: where networks live.
        """
        self.seeds, self.device = tuple(seeds), torch.device(device)
        device = self.device
        replicas, self._states, self._actions = len(seeds), observations, actions
        self._entropy = float(-actions) if self.target_entropy is None else self.target_entropy
        mine = Shape(observations, 2 * actions, self.width, self.depth)
        judge = Shape(observations + actions, 1, self.width, self.depth, self.layer_norm)
        members, size = CRITICS * replicas, mine.numel(replicas)

        def zeros(length: int) -> Tensor:
            return torch.zeros(length, device=device)

        weights, by_weights = zeros(size + padded(replicas)), zeros(size + padded(replicas))  # actors, then log α
        self.actor, self.average = Stack(mine, replicas, weights[:size]), Stack(mine, replicas, zeros(size))
        self.log_alpha = weights[size : size + replicas].fill_(math.log(self.temperature))
        self.critic, self.target = (Stack(judge, members, zeros(judge.numel(members))) for _ in range(2))
        by_actor, by_critic = (
            Stack(mine, replicas, by_weights[:size]),
            Stack(judge, members, zeros(judge.numel(members))),
        )
        by_log_alpha = by_weights[size : size + replicas]
        self.actor.draw(generators(seeds, "sac/actor"))
        twins = [generators(seeds, f"sac/critic {c}") for c in range(CRITICS)]
        self.critic.draw([twin for pair in zip(*twins, strict=True) for twin in pair])
        self.average.flat.copy_(self.actor.flat)
        self.target.flat.copy_(self.critic.flat)
        room = entropy_room(self.discount, actions, self._entropy) if self.target_clip else None
        gradients = Gradients(
            self.actor, self.critic, self.target, by_actor, by_critic, by_log_alpha, self._entropy, room
        )
        self._gradients = Compiled(gradients) if self.compile else gradients
        self._by_log_alpha = by_log_alpha
        self._adam = Adam(weights, by_weights, self.learning_rate)
        self._critic_adam = Adam(self.critic.flat, by_critic.flat, self.learning_rate)
        self._noise = Draws(seeds, "sac/update", device)
        self._exploration = Draws(seeds, "sac/exploration", device)
        self.count = 0

    def replay(self, problem: Problem) -> Replay:
        """An empty memory with this learner's settings.

        Raises:
            UserError: the learner was made for other sizes or seeds, or not at all.
        """
        states = problem.states if problem.finite_states else problem.observations
        made = getattr(self, "seeds", ()), getattr(self, "_states", None), getattr(self, "_actions", None)
        if made != (wanted := (problem.seeds, states, problem.actions)):
            raise UserError(
                f"this learner was made for seeds, observations and actions {made}, and the problem has {wanted}: call "
                "make(observations, actions, seeds) with those first"
            )
        return Replay(problem, self.n_step, self.discount, self.prefer, self.success_share, purpose="sac/replay")

    @torch.no_grad()
    def mean(self, states: Tensor, averaged: bool = False) -> Tensor:
        """The actions without noise [R, K, A] for states [R, K, ...], of the actors or of their averages."""
        actor = self.average if averaged else self.actor
        tape = Tape(actor.shape, actor.members, states.shape[1], self.device)
        tape.input.copy_(encoded(self.seen(states), self._states))
        return actor.forward(tape).chunk(2, -1)[0].tanh()

    def policy(self, copies: int, horizon: int, averaged: bool = False) -> Policy:
        """The actors, or their averages, as a collector's policy for `copies` environments a replica."""
        return Policy(self.average if averaged else self.actor, self._exploration, copies, horizon)

    def round_updates(self, first: bool, transitions: Sequence[int]) -> int:
        """How many updates a round takes.

        Args:
            first: whether it is the first. transitions: new ones of each replica.

        Raises:
            UserError: `update_ratio` where replicas have different numbers of new transitions.
        """
        if not self.update_ratio:
            return self.first_updates if first else self.updates
        if len(set(transitions)) > 1:
            raise UserError(
                f"update_ratio={self.update_ratio}: seeds side by side do the same number of updates, but have "
                f"{sorted(set(transitions))} new transitions; set update_ratio=0, or run one seed a job (replicas=1)"
            )
        return max(1, round(self.update_ratio * transitions[0]))

    @flushed()
    def fit(self, replay: Replay, updates: int) -> dict[str, Tensor]:
        """Some updates on what is in the buffer.

        Returns:
            Of the last update in which each was due: the losses `critic`, `actor` and `alpha`, the mean target `q`,
            `entropy`, and α as `temperature`, each [R]; those of the actor are missing where it never was.

        Raises:
            UserError: no update, or nothing to learn from. RunError: a weight is not finite.
        """
        if updates < 1:
            raise UserError(f"updates={updates}: at least 1 is allowed")
        of_actor: Terms | None = None
        for done in range(0, updates, BLOCK):
            count = min(BLOCK, updates - done)
            noise = self._noise.normal(count, 2, self.batch, self._actions, axis=2)
            for batch, part in zip(replay.sample(self.batch, count), noise, strict=True):
                terms = self.update(batch, part)
                of_actor = of_actor if terms.log_prob is None else terms
        self.check()
        values = dict[str, Tensor]()
        if of_actor is not None and of_actor.log_prob is not None:
            values = losses(of_actor, self.log_alpha, self._entropy)
            values |= {"entropy": -of_actor.log_prob.mean(-1), "temperature": self.log_alpha.exp()}
        return (
            values | losses(terms._replace(log_prob=None), self.log_alpha, self._entropy) | {"q": terms.target.mean(-1)}
        )

    def update(self, batch: Batch, noise: Tensor) -> Terms:
        """One gradient step of the critics and, where it is due, of actor and α, all from the same weights.

        Args:
            batch: transitions [R, B]. noise: standard normal ε [2, R, B, A], for the actions at s and at s′.
        """
        self.count += 1
        seen, ahead = (encoded(self.seen(states), self._states) for states in (batch.observation, batch.ahead))
        batch = batch._replace(observation=seen, ahead=ahead)
        due = self.count % self.policy_delay == 0
        terms = self._gradients(batch, noise, self.log_alpha, due)
        if due and not self.adapt_temperature:
            self._by_log_alpha.zero_()
        step(self._critic_adam, *([self._adam] if due else []))
        self.target.flat.lerp_(self.critic.flat, self.target_rate)
        if due:
            self.average.flat.lerp_(self.actor.flat, self.average_rate)
        return terms

    def check(self) -> None:
        """Raise RunError, with seed and network, if a weight is not finite."""
        after = f" after {self.count} updates; are the rewards finite? else try a smaller learning_rate"
        for name, stack in (("actor", self.actor), ("critic", self.critic)):
            require_finite(f"SAC: a weight of the {name}", stack.blocks, self.seeds, after)

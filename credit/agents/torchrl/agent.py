"""Any of TorchRL's losses that has a recipe, as the policy optimizer of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import torch
from annotated_types import Interval
from torch import Tensor

from credit.agents.seeing import Seeing
from credit.agents.torchrl.learner import Learner
from credit.agents.torchrl.memory import Memory
from credit.agents.torchrl.noise import Noise
from credit.agents.torchrl.policy import Following
from credit.agents.torchrl.recipes import RECIPES, recipe
from credit.agents.torchrl.rounds import judged, minibatches
from credit.agents.torchrl.rows import drawn, newest, numbers_seen
from credit.core.checks import check_rewards
from credit.core.component import Kind
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegative, Positive, PositiveInt, Probability
from credit.core.seams import Agent, CreditAssigner, Encoder
from credit.core.store import Store
from credit.networks.modules import Activation, Network, Perceptron

BLOCK = 32  # batches drawn at once


class TorchRL(Seeing, Agent):
    """One of TorchRL's losses: PPO, TD3 or discrete SAC.

    Every replica has a loss module, an optimizer and target networks of its own; replicas learn in a loop, one after
    the other, since not every loss can be vectorised over them. Networks see a state (one-hot where it is a number),
    and not when it is. What is judged is the policy without exploration.

    PPO learns from the newest round alone, after its rewards were made, and only where it acted in that round: of
    demonstrations it learns nothing, and from steps whose labels come in a later round, since they are late or their
    window was open, only its reward model learns; a round should be longer than a window. The others learn from a
    replay of everything that is remembered, whose rewards are made anew after every refit.

    Args:
        loss: ppo (any actions), td3 (vectors), or discrete_sac (numbers).
        network: what makes actor and critics; None for perceptrons with
        hidden: layers of these widths, and this
        activation: between them.
        learning_rate: Adam's. discount: γ. batch: steps a gradient step.
        critic_loss: squared error, or smooth_l1, which is linear beyond an error of 1.
        gradient_clip: largest norm of a gradient; None for any.
        epochs: of ppo: how often it goes through a round. clip: ε, by which the ratio of probabilities may leave 1.
        entropy: of ppo: weight of the entropy in its objective. gae_lambda: λ of its advantages.
        updates_per_step: of the others: gradient steps for every step that a replica has newly collected.
        n_step: n, steps of reward before the target's bootstrap. capacity: windows that are remembered, the newest;
            None for all.
        tau: τ, at which the targets follow. policy_delay: gradient steps of the critics for one of actor and targets.
        noise: of td3: deviation of the noise that exploration adds to actions. target_noise: of that which smooths
            targets. target_noise_clip: the most that this may be.
        temperature: of discrete_sac: α at the start. target_entropy: what α is adapted to, as a share of the largest
            entropy.
        encoder: how networks see a vector; None for as it is.

    Raises:
        UserError: at the start: a loss that does not take the problem's actions.

    Example:
        >>> Trainer(env, feedback, assigner, TorchRL("ppo", learning_rate=0.001))
    """

    keeps: ClassVar = ("_learners", "_noise", "_replay", "_rounds", "_acted", "_told")
    acts: ClassVar = ("_learners",)

    def __init__(
        self,
        loss: Literal["ppo", "td3", "discrete_sac"],
        network: Network | None = None,
        hidden: Sequence[PositiveInt] = (64, 64),
        activation: Activation = "tanh",
        learning_rate: Positive = 3e-4,
        discount: Probability = 0.99,
        batch: PositiveInt = 64,
        critic_loss: Literal["l2", "smooth_l1"] = "l2",
        gradient_clip: Positive | None = None,
        epochs: PositiveInt = 10,
        clip: Annotated[float, Interval(gt=0, lt=1)] = 0.2,
        entropy: NonNegative = 0.01,
        gae_lambda: Probability = 0.95,
        updates_per_step: Positive = 1.0,
        n_step: PositiveInt = 1,
        capacity: PositiveInt | None = None,
        tau: Annotated[float, Interval(gt=0, le=1)] = 0.005,
        policy_delay: PositiveInt = 1,
        noise: NonNegative = 0.1,
        target_noise: NonNegative = 0.2,
        target_noise_clip: NonNegative = 0.5,
        temperature: Positive = 1.0,
        target_entropy: Probability = 0.98,
        encoder: Encoder | None = None,
    ) -> None:
        self.loss = loss
        self.network = network
        self.hidden, self.activation = tuple(hidden), activation
        self.learning_rate, self.discount, self.batch = learning_rate, discount, batch
        self.critic_loss, self.gradient_clip = critic_loss, gradient_clip
        self.epochs, self.clip, self.entropy, self.gae_lambda = epochs, clip, entropy, gae_lambda
        self.updates_per_step, self.n_step, self.capacity = updates_per_step, n_step, capacity
        self.tau, self.policy_delay = tau, policy_delay
        self.noise, self.target_noise, self.target_noise_clip = noise, target_noise, target_noise_clip
        self.temperature, self.target_entropy = temperature, target_entropy
        self.encoder = encoder

    @property
    def actions(self) -> Kind:  # type: ignore[override]
        """Those that the loss takes."""
        return RECIPES[self.loss].actions

    @property
    def newest(self) -> bool:
        """PPO does."""
        return self.loss == "ppo"

    def start(self, problem: Problem) -> None:
        """Fresh networks, nothing to replay."""
        self._problem, self._recipe = problem, recipe(self.loss, problem)
        self._head = self._recipe.head(self, problem)
        self.open_eyes(problem)
        network = self.network or Perceptron(self.hidden, self.activation)
        self._learners = [Learner(self._recipe, self._head, self, network, problem, seed) for seed in problem.seeds]
        self._noise = Noise(problem, "torchrl/exploration", self._head.noise, self._head.width)
        self._replay = None if self._recipe.newest else Memory(problem, self.n_step, self.discount, self.capacity)
        self._rounds, self._acted = 0, False
        unknown = torch.full((problem.replicas,), torch.nan, dtype=FLOAT, device=problem.device)
        self._told = {name: unknown.clone() for name in self._recipe.reports}

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions that explore: sampled, or with noise."""
        self._acted = True
        return self.executed().act(states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Learn from the newest round, or from all that is remembered, with the newest rewards.

        Raises:
            RunError: a weight is not finite.
        """
        if self._replay is None:
            self._learn_newest(store, assigner)
            self.look(store.new)  # afterwards: who learns must see what who acted saw
        else:
            self._replay.update(store, assigner)
            self.look(store.new)
            self._learn_replayed(self._replay, store)
        self._rounds += 1

    def policies(self) -> dict[str, Policy]:
        """The best actions, by the actors as they are."""
        return {"behaviour": self._following()}

    def executed(self) -> Policy:
        """The actors with exploration."""
        return self._following(self._noise)

    def diagnostics(self) -> dict[str, Tensor]:
        """Losses and what else the loss tells, of the last update that moved the actor."""
        return {name: value.clone() for name, value in self._told.items()}

    def _following(self, noise: Noise | None = None) -> Following:
        return Following(self._learners, self._head, numbers_seen(self._problem), self.seen, noise)

    def _learn_newest(self, store: Store, assigner: CreditAssigner) -> None:
        windows, acted = store.new, self._acted
        self._acted = False
        if not acted or not len(windows):
            return
        rewards = assigner.rewards(windows)
        check_rewards(windows, rewards, self._problem)
        if self.encoder is not None:
            seen, ahead = self.seen(windows.states), self.seen(windows.next_states)
            windows = replace(windows, states=seen, next_states=ahead)
        every = newest(windows, rewards, self._problem)
        for replica, (learner, data) in enumerate(zip(self._learners, every, strict=True)):
            if len(data):
                with learner.random("round", self._rounds):
                    self._note(replica, learner.fit(minibatches(judged(learner.loss, data), self.batch, self.epochs)))

    def _learn_replayed(self, replay: Memory, store: Store) -> None:
        windows = store.new
        steps = [len(windows)] * len(self._learners) if windows.count is None else windows.count.tolist()
        wanted = [max(1, round(self.updates_per_step * count)) if count else 0 for count in steps]
        replay.begin(self._rounds)
        for block, done in enumerate(range(0, max(wanted), BLOCK)):
            batches = replay.sample(self.batch, min(BLOCK, max(wanted) - done))
            batches = [
                batch._replace(observation=self.seen(batch.observation), ahead=self.seen(batch.ahead))
                for batch in batches
            ]
            for replica, learner in enumerate(self._learners):
                mine = batches[: max(0, wanted[replica] - done)]
                with learner.random(f"update, block {block}", self._rounds):
                    self._note(
                        replica, learner.fit(drawn(batch, replica, self._problem, self.discount) for batch in mine)
                    )

    def _note(self, replica: int, told: dict[str, Tensor]) -> None:
        for name, value in told.items():
            self._told[name][replica] = value

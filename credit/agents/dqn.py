"""Deep Q-learning on relabelled steps of episodes: the delayed baseline of A.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor
from torch.nn.functional import mse_loss, smooth_l1_loss

from credit.agents.exploring import EpsilonGreedy
from credit.agents.moments import Moments, Vectors
from credit.agents.seeing import Seeing
from credit.core.checks import require_finite
from credit.core.component import Kind, Setting
from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegative, NonNegativeInt, Positive, PositiveInt, Probability
from credit.core.seams import Agent, CreditAssigner, Encoder, FeatureMap
from credit.core.store import Store
from credit.core.streams import each_step, reset_seed
from credit.data.replay import Batch, Replay
from credit.networks.modules import Network
from credit.networks.perceptron import PRECISION, ReplicaDueling, ReplicaMLP
from credit.networks.replicated import ReplicaNetwork, Replicated
from credit.networks.seeding import seeded

LOSSES = {"l2": mse_loss, "smooth_l1": smooth_l1_loss}


class DQN(Seeing, Agent):
    """Deep Q-learning with replay and a target network, ε-greedy, one network a replica (A.2).

    Q(s, t, ·) is a network on φ(s) and the step t (one-hot where states are numbers, t/T where they are vectors),
    fitted by Adam to targets (1−m)·(r + γ Q⁻(s', t+1, a*)) + m·G with G the return to the end of the episode. Nothing
    lies behind a terminated step, nor behind step T: there, the target is r. Not `timed`, it is Q(s, ·), and step T is
    a time limit, behind which the task would go on; or the task never ends. Actions are numbers, states numbers or
    vectors.

    Args:
        features: φ, what the network sees of a state; None for all of it: one-hot, or the vector as it is.
        learning_rate: Adam's.
        discount: γ.
        hidden: widths of the layers between input and action values.
        batch: steps a gradient step.
        updates: gradient steps a window. update_ratio: gradient steps for each step taken; 0 leaves it to `updates`.
        target_sync: gradient steps between two copies of the network to the target network Q⁻.
        capacity: windows that are remembered, the newest ones.
        epsilon: exploration in the first window.
        epsilon_floor: exploration in the end.
        epsilon_windows: windows over which ε falls from one to the other, linearly. epsilon_steps: steps over which it
            does; 0 leaves it to `epsilon_windows`.
        n_step: steps of reward before the bootstrap.
        monte_carlo: m, the share of the return in the target.
        double: whether a* is the network's choice (double DQN) or that of the target network itself.
        loss: squared error, or smooth_l1, which is linear beyond an error of 1.
        timed: whether values depend on the step.
        dueling: whether Q is V + A − mean A, with a stream of its own for each behind the last but one hidden layer.
        encoder: how the network sees a vector; None for as it is.
        network: what makes the network; None for a perceptron of `hidden` layers.
        gradient_clip: largest norm of a gradient; None for any.

    Raises:
        UserError: ε would rise; there are features and an encoder, or a network that is to be dueling.
    """

    actions: ClassVar[Kind] = "finite"
    setting: ClassVar[Setting] = "episodic"
    keeps: ClassVar = ("_online", "_target", "_adam", "_replay", "_stream", "_windows", "_steps", "_updates")
    acts: ClassVar = ("_online",)

    def __init__(
        self,
        features: FeatureMap | None = None,
        learning_rate: Positive = 0.001,
        discount: Probability = 1.0,
        hidden: Sequence[PositiveInt] = (64, 64),
        batch: PositiveInt = 64,
        updates: PositiveInt = 1,
        update_ratio: NonNegative = 0.0,
        n_step: PositiveInt = 1,
        target_sync: PositiveInt = 100,
        capacity: PositiveInt = 5000,
        epsilon: Probability = 1.0,
        epsilon_floor: Probability = 0.05,
        epsilon_windows: PositiveInt = 900,
        epsilon_steps: NonNegativeInt = 0,
        monte_carlo: Probability = 0.0,
        double: bool = True,
        loss: Literal["l2", "smooth_l1"] = "l2",
        timed: bool = True,
        dueling: bool = False,
        encoder: Encoder | None = None,
        network: Network | None = None,
        gradient_clip: Positive | None = None,
    ) -> None:
        if dueling and network is not None:
            raise UserError(
                f"agent.dueling=true with agent.network={type(network).__name__}: a network of its own says how it "
                "comes to action values; leave one out (agent.dueling=false, or agent.network=null)"
            )
        if features is not None and encoder is not None:
            raise UserError(
                f"encoder={type(encoder).__name__} and agent.features={type(features).__name__}: both say what the "
                "network sees of a state; leave one out (encoder=null, or agent.features=null)"
            )
        if epsilon_floor > epsilon:
            raise UserError(
                f"agent.epsilon_floor={epsilon_floor}: exploration falls to it, so it is at most "
                f"agent.epsilon={epsilon}; lower the one or raise the other"
            )
        self.features = features
        self.learning_rate = learning_rate
        self.discount = discount
        self.hidden = tuple(hidden)
        self.batch = batch
        self.updates, self.update_ratio = updates, update_ratio
        self.n_step = n_step
        self.target_sync = target_sync
        self.capacity = capacity
        self.epsilon = epsilon
        self.epsilon_floor = epsilon_floor
        self.epsilon_windows, self.epsilon_steps = epsilon_windows, epsilon_steps
        self.monte_carlo = monte_carlo
        self.double = double
        self.loss = loss
        self.timed = timed
        if not timed:
            self.setting = "any"  # type: ignore[misc]
        self.dueling = dueling
        self.encoder = encoder
        self.network = network
        self.gradient_clip = gradient_clip

    def start(self, problem: Problem) -> None:
        """Random networks, nothing to replay.

        Raises:
            UserError: returns to the end of an episode, where none ends.
        """
        if self.monte_carlo and not problem.episodic:
            raise UserError(
                f"agent.monte_carlo={self.monte_carlo}: returns run to the end of an episode, and here none ends; "
                "leave it at 0"
            )
        self._problem = problem
        if self.features is not None:
            self.features.start(problem)
        self.open_eyes(problem)
        self._view = (
            Moments(problem, self.features, self.timed)
            if problem.finite_states
            else Vectors(problem, self.features, self.encoder, self.timed)
        )
        self._online = self._network(problem)
        self._target = deepcopy(self._online)
        self._adam = torch.optim.Adam(self._online.parameters(), lr=self.learning_rate)
        self._replay = Replay(
            problem, self.n_step, self.discount, capacity=self.capacity, outcome=self.monte_carlo > 0, kind=FLOAT
        )
        self._stream = each_step(problem, "epsilon-greedy", "uniform", 2)
        self._windows, self._steps, self._updates = 0, 0, 0
        self._policy = self._view.greedy(self._online)

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """A uniform action with probability ε, else the best."""
        return self.executed().act(states, step)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """See all that is remembered with the newest rewards, and fit.

        Raises:
            RunError: a weight is not finite.
        """
        count = store.new.labels.shape[1]
        self._replay.update(store, assigner)
        self.look(store.new)
        updates = self.updates * count
        if self.update_ratio:  # what is left of one goes to the next round
            updates = int(self.update_ratio * (self._steps + store.taken)) - int(self.update_ratio * self._steps)
        for batch in self._replay.sample(self.batch, updates):
            self._fit(batch)
        after = f" after {self._updates} updates; are the rewards finite? else try a smaller agent.learning_rate"
        require_finite("DQN: a weight", self._online.parameters(), self._problem.seeds, after)
        self._windows += count
        self._steps += store.taken
        self._policy = self._view.greedy(self._online)

    def policies(self) -> dict[str, Policy]:
        """Greedy by step; exploration is not counted as an error of the policy."""
        return {"behaviour": self._policy, "greedy": self._policy}

    def executed(self) -> EpsilonGreedy:
        """ε-greedy."""
        return EpsilonGreedy(self._policy, self._exploration(), self._problem.actions, self._stream)

    def remark(self) -> str:
        """Whether replicas learn one after the other."""
        if isinstance(self._online, Replicated) and self._online.loops:
            return "agent.network: torch.func does not carry this module over seeds, which learn one after the other"
        return ""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; what is greedy follows from the network."""
        super().load_state_dict(state)
        self._policy = self._view.greedy(self._online)

    def _network(self, problem: Problem) -> ReplicaNetwork:
        """Fresh action values."""
        if self.network is None:
            kind = ReplicaDueling if self.dueling else ReplicaMLP
            return kind(problem, self._view.size, problem.actions, self.hidden, "action values")
        made = []
        for seed in problem.seeds:
            with seeded(reset_seed(seed, "action values, network", 0, 0), problem.device):
                made.append(self.network.make(self._view.size, problem.actions, problem.device))
        return Replicated(made, self._view.size)

    def _exploration(self) -> float:
        done = self._steps / self.epsilon_steps if self.epsilon_steps else self._windows / self.epsilon_windows
        done = min(done, 1)
        return self.epsilon + (self.epsilon_floor - self.epsilon) * done

    def _fit(self, batch: Batch) -> None:
        """One gradient step on B steps of every replica."""
        assert batch.step is not None
        after = batch.step + 1 if batch.after is None else batch.after
        over = batch.discount == 0
        if self.timed:  # no network has seen what is behind step T
            over = over | (after >= self._problem.horizon)
        ahead = self._ahead(self._view(batch.ahead, after)).masked_fill(over, 0)
        discount = self.discount if batch.after is None else batch.discount
        goal = targets(batch.returns, ahead, batch.outcome, discount, self.monte_carlo).to(PRECISION)
        seen = self._view(batch.observation, batch.step)
        values = self._online(seen).gather(-1, batch.action.unsqueeze(-1)).squeeze(-1)
        # the sum over replicas gives each the gradient that it would have alone
        error = LOSSES[self.loss](values, goal, reduction="none").mean(1).sum()
        self._adam.zero_grad()
        error.backward()
        if self.gradient_clip is not None:
            clip_each(list(self._online.parameters()), self.gradient_clip)
        self._adam.step()
        self._updates += 1
        if self._updates % self.target_sync == 0:
            self._target.load_state_dict(self._online.state_dict())

    @torch.no_grad()
    def _ahead(self, inputs: Tensor) -> Tensor:
        """Q⁻ of the best action [R, B]."""
        values = self._target(inputs)
        choice = (self._online(inputs) if self.double else values).argmax(-1, keepdim=True)
        return values.gather(-1, choice).squeeze(-1)


def clip_each(weights: Sequence[Tensor], norm: float) -> None:
    """Shorten the gradient of each replica to a norm, if it is longer, as `torch.nn.utils.clip_grad_norm_` does.

    Args:
        weights: of all replicas, each [R, …]; their gradients are changed in place.
    """
    gradients = [weight.grad for weight in weights if weight.grad is not None]
    length = torch.stack([gradient.flatten(1).square().sum(1) for gradient in gradients]).sum(0).sqrt()
    factor = (norm / (length + 1e-6)).clamp(max=1)
    for gradient in gradients:
        gradient.mul_(factor.view(-1, *[1] * (gradient.dim() - 1)))


def targets(
    reward: Tensor, ahead: Tensor, outcome: Tensor | None, discount: float | Tensor, monte_carlo: float
) -> Tensor:
    """(1−m)·(r + γ·ahead) + m·G of rewards r, next values (0 after a last step) and returns G, all of one shape.

    Without returns m is 0.
    """
    goal = reward + discount * ahead
    return goal if outcome is None else torch.lerp(goal, outcome, monte_carlo)

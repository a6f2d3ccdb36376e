"""Deep Q-learning on relabelled steps of episodes: the delayed baseline of A.2."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import ClassVar, Literal

import torch
from torch import Tensor
from torch.nn.functional import mse_loss, smooth_l1_loss

from credit.core.errors import UserError
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Positive, PositiveInt, Probability
from credit.core.seams import Agent, CreditAssigner, FeatureMap
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.streams import Stream
from credit.data.replay import Batch, Replay
from credit.networks.perceptron import PRECISION, ReplicaMLP

LOSSES = {"l2": mse_loss, "smooth_l1": smooth_l1_loss}


class DQN(Agent):
    """Deep Q-learning with replay and a target network, ε-greedy, one network a replica (A.2).

    Q(s, t, ·) is a network on φ(s) and the one-hot step t, fitted to targets (1−m)·(r + γ Q⁻(s', t+1, a*)) + m·G with
    G the return to the end of the window, by Adam. Nothing lies beyond a window's last step: there, the target is r.

    Args:
        features: φ, what the network sees of a state.
        learning_rate: Adam's.
        discount: γ.
        hidden: widths of the layers between input and action values.
        batch: steps a gradient step.
        updates: gradient steps a window.
        target_sync: gradient steps between two copies of the network to the target network Q⁻.
        capacity: windows that are remembered, the newest ones.
        epsilon: exploration in the first window.
        epsilon_floor: exploration in the end.
        epsilon_windows: windows over which ε falls from one to the other, linearly.
        monte_carlo: m, the share of the return in the target.
        double: whether a* is the network's choice (double DQN) or that of the target network itself.
        loss: squared error, or smooth_l1, which is linear beyond an error of 1.

    Raises:
        UserError: ε would rise.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    setting: ClassVar = "episodic"
    keeps: ClassVar = ("_online", "_target", "_adam", "_replay", "_stream", "_windows", "_updates", "_policy")

    def __init__(
        self,
        features: FeatureMap,
        learning_rate: Positive = 0.001,
        discount: Probability = 1.0,
        hidden: Sequence[PositiveInt] = (64, 64),
        batch: PositiveInt = 64,
        updates: PositiveInt = 1,
        target_sync: PositiveInt = 100,
        capacity: PositiveInt = 5000,
        epsilon: Probability = 1.0,
        epsilon_floor: Probability = 0.05,
        epsilon_windows: PositiveInt = 900,
        monte_carlo: Probability = 0.0,
        double: bool = True,
        loss: Literal["l2", "smooth_l1"] = "l2",
    ) -> None:
        if epsilon_floor > epsilon:
            raise UserError(
                f"optimizer.epsilon_floor={epsilon_floor}: exploration falls to it, so it is at most "
                f"optimizer.epsilon={epsilon}; lower the one or raise the other"
            )
        self.features = features
        self.learning_rate = learning_rate
        self.discount = discount
        self.hidden = tuple(hidden)
        self.batch = batch
        self.updates = updates
        self.target_sync = target_sync
        self.capacity = capacity
        self.epsilon = epsilon
        self.epsilon_floor = epsilon_floor
        self.epsilon_windows = epsilon_windows
        self.monte_carlo = monte_carlo
        self.double = double
        self.loss = loss

    def start(self, problem: Problem) -> None:
        """Random networks, nothing to replay."""
        self._problem = problem
        self._inputs = self._encoded(problem)
        self._online = ReplicaMLP(problem, self._inputs.shape[1], problem.actions, self.hidden, "action values")
        self._target = deepcopy(self._online)
        self._adam = torch.optim.Adam(self._online.parameters(), lr=self.learning_rate)
        self._replay = Replay(problem, 1, self.discount, capacity=self.capacity, outcome=True, kind=FLOAT)
        self._stream = Stream(problem, "epsilon-greedy", "uniform", 2)
        self._windows, self._updates = 0, 0
        self._policy = self._greedy()

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """A uniform action with probability ε, else the best."""
        uniform = self._stream.next()
        explore = uniform[:, :1] < self._exploration()
        best = TablePolicy(self._policy, self._problem.actions).act(states, step)
        return torch.where(explore, (uniform[:, 1:] * self._problem.actions).to(torch.int64), best)

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """See all that is remembered with the newest rewards, and fit."""
        count = store.new.labels.shape[1]
        self._replay.relabel(store.windows, assigner.rewards(store.windows))
        for batch in self._replay.sample(self.batch, self.updates * count):
            self._fit(batch)
        self._windows += count
        self._policy = self._greedy()

    def policies(self) -> dict[str, Policy]:
        """Greedy by step; exploration is not counted as an error of the policy."""
        policy = TablePolicy(self._policy, self._problem.actions)
        return {"behaviour": policy, "greedy": policy}

    def executed(self) -> Policy:
        """ε-greedy."""
        return EpsilonGreedy(self._policy, self._problem.actions, self._exploration())

    def _encoded(self, problem: Problem) -> Tensor:
        """What the network sees of every moment t·S + s: φ(s) and the one-hot t [T·S, d+T]."""
        self.features.start(problem)
        states = torch.arange(problem.states, device=problem.device)
        nothing = torch.zeros_like(states)
        features = self.features(Steps(states, nothing, nothing, nothing)).to(PRECISION)
        clock = torch.eye(problem.window, dtype=PRECISION, device=problem.device)
        return torch.cat([features.repeat(problem.window, 1), clock.repeat_interleave(problem.states, dim=0)], dim=1)

    def _greedy(self) -> Tensor:
        return self._online.best(self._inputs).view(-1, self._problem.window, self._problem.states)

    def _exploration(self) -> float:
        done = min(self._windows / self.epsilon_windows, 1)
        return self.epsilon + (self.epsilon_floor - self.epsilon) * done

    def _fit(self, batch: Batch) -> None:
        """One gradient step on B steps of every replica."""
        assert batch.step is not None
        assert batch.outcome is not None
        states, horizon = self._problem.states, self._problem.window
        moment = batch.step * states + batch.observation
        # after the last step there is no moment; what stands in for it is not looked at
        arrival = (batch.step + 1) % horizon * states + batch.ahead
        ahead = self._ahead(self._inputs[arrival]).masked_fill(batch.discount == 0, 0)
        goal = targets(batch.returns, ahead, batch.outcome, self.discount, self.monte_carlo).to(PRECISION)
        values = self._online(self._inputs[moment]).gather(-1, batch.action.unsqueeze(-1)).squeeze(-1)
        # the sum over replicas gives each the gradient that it would have alone
        error = LOSSES[self.loss](values, goal, reduction="none").mean(1).sum()
        self._adam.zero_grad()
        error.backward()
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


class EpsilonGreedy(TablePolicy):
    """A uniform action with probability ε, else that of a table.

    Args:
        actions: [R, T, S]. count: A. epsilon: ε.
    """

    def __init__(self, actions: Tensor, count: int, epsilon: float) -> None:
        super().__init__(actions, count)
        self.epsilon = epsilon

    def probabilities(self, states: Tensor, step: int) -> Tensor:
        """ε/A for every action, and 1 − ε more for the best."""
        table = super().probabilities(states, step)
        return self.epsilon / self.count + (1 - self.epsilon) * table


def targets(reward: Tensor, ahead: Tensor, outcome: Tensor, discount: float, monte_carlo: float) -> Tensor:
    """(1−m)·(r + γ·ahead) + m·G of rewards r, next values (0 after a last step) and returns G, all of one shape."""
    return torch.lerp(reward + discount * ahead, outcome, monte_carlo)

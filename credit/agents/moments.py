"""What a network of action values sees: a state and when it is, as numbers or as vectors."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Encoder, FeatureMap
from credit.core.steps import Steps
from credit.networks.perceptron import PRECISION
from credit.networks.replicated import ReplicaNetwork

MOST = 2**30  # numbers of a table of all that may be seen, 4 GB


class Moments:
    """States are numbers: φ(s), or s one-hot, and the one-hot step of a window.

    Args:
        problem: sizes. features: φ, started; None for one-hot states. timed: whether the step is seen.

    Raises:
        UserError: too many to be listed.

    Attributes:
        size: how many numbers that is.
    """

    def __init__(self, problem: Problem, features: FeatureMap | None, timed: bool = True) -> None:
        self._problem, self._timed = problem, timed
        steps = problem.horizon if timed else 0
        if features is None and (size := problem.states * max(steps, 1) * (problem.states + steps)) > MOST:
            moments = f"{problem.states} states" + f" at {steps} steps" * timed
            less = "leave out the clock (agent.timed=false), " if timed else ""
            raise UserError(
                f"an agent that sees {moments} one-hot has a table of {size:.1e} numbers, and at most {MOST:.1e} are "
                f"kept: {less}name what it sees of a state (+features@agent.features=…), or wrap the environment so "
                "that it has fewer"
            )
        states = torch.arange(problem.states, device=problem.device)
        nothing = torch.zeros_like(states)
        if features is None:
            seen = torch.eye(problem.states, dtype=PRECISION, device=problem.device)
        else:
            seen = features(Steps(states, nothing, nothing, nothing)).to(PRECISION)
        self._inputs = seen
        if timed:  # of every moment t·S + s [T·S, d+T]
            clock = torch.eye(problem.horizon, dtype=PRECISION, device=problem.device)
            seen, clock = seen.repeat(problem.horizon, 1), clock.repeat_interleave(len(states), dim=0)
            self._inputs = torch.cat([seen, clock], dim=1)
        self.size = self._inputs.shape[1]

    def __call__(self, states: Tensor, step: Tensor) -> Tensor:
        """Inputs [..., size] for states [...] at steps [...]; behind the last step, the last one stands in."""
        if not self._timed:
            return self._inputs[states]
        return self._inputs[step.clamp(max=self._problem.horizon - 1) * self._problem.states + states]

    def greedy(self, values: ReplicaNetwork) -> Policy:
        """The best action in every moment, as a table."""
        best = values.best(self._inputs)
        moments = (self._problem.horizon, self._problem.states) if self._timed else (self._problem.states,)
        return TablePolicy(best.view(-1, *moments), self._problem.actions)


class Vectors:
    """States are vectors: φ(s), or s as it is, and the share of the window that is over.

    Args:
        problem: sizes. features: φ, started; None for the vectors themselves. encoder: as this one, started, sees them;
            None for as they are. timed: whether that share is seen.

    Attributes:
        size: how many numbers that is.
    """

    def __init__(
        self, problem: Problem, features: FeatureMap | None, encoder: Encoder | None = None, timed: bool = True
    ) -> None:
        self._problem, self._features, self._encoder, self._timed = problem, features, encoder, timed
        blank = problem.blank()
        self.size = self(blank.states, blank.times).shape[-1]

    def __call__(self, states: Tensor, step: Tensor) -> Tensor:
        """Inputs [..., size] for states [..., O] at steps [...]."""
        seen = states if self._encoder is None else self._encoder(states)
        if self._features is not None:
            nothing = torch.zeros_like(step)
            seen = self._features(Steps(states, nothing, states, step))
        if not self._timed:
            return seen.to(PRECISION)
        share = step.unsqueeze(-1) / self._problem.horizon
        return torch.cat([seen.to(PRECISION), share.to(PRECISION).expand(*seen.shape[:-1], 1)], dim=-1)

    def greedy(self, values: ReplicaNetwork) -> Policy:
        """The best action, as the network has it now."""
        return Best(self, values)


class Best(Policy):
    """The action of the largest value.

    Args:
        view: what the network sees. values: the network.
    """

    def __init__(self, view: Vectors, values: ReplicaNetwork) -> None:
        self._view, self._values = view, values

    @torch.no_grad()
    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions [R, K]."""
        return self._values(self._view(states, step)).argmax(-1)

    @torch.no_grad()
    def probabilities(self, states: Tensor, step: int) -> Tensor:
        """One for the action, zero for the others [R, n, A]."""
        steps = torch.full(states.shape[:1], step, device=states.device)
        replicas = next(self._values.parameters()).shape[0]
        values = self._values(self._view(states, steps).expand(replicas, -1, -1))
        return torch.nn.functional.one_hot(values.argmax(-1), values.shape[-1]).to(FLOAT)

"""Problems with real-valued states and actions: their records, and the seams that only they have.

What is a table elsewhere is a column of rows here: one row a step, of all replicas together, in the order in which
trajectories came. The equations are the same functions, on [M, N] with N rows.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from credit.cells import Steps
from credit.component import Component
from credit.interfaces import FeatureMap, RewardModel, Uncertainty
from credit.types import Belief, Replicas


@dataclass(frozen=True)
class ContinuousProblem(Replicas):
    """What a learner may know before its first step.

    Attributes:
        observations: numbers in a state. actions: numbers in an action, each in [−1, 1].
        window: H, most steps of a trajectory. seeds: one a replica. device: where tensors live.
    """

    observations: int
    actions: int
    window: int
    seeds: tuple[int, ...]
    device: torch.device
    episodic: bool = True


@dataclass(frozen=True)
class Moves(Steps):
    """Steps in rows: states [N, O], actions [N, A], next_states [N, O], float32.

    Attributes:
        replica: of each row [N], int64.
    """

    replica: Tensor

    def __len__(self) -> int:
        """N."""
        return len(self.states)


@dataclass(frozen=True)
class Trajectories(Moves):
    """Labelled trajectories of R replicas, K each: their steps in N rows, a trajectory's one behind the other.

    Attributes:
        number: which of its replica's trajectories a row belongs to [N], 0 … K − 1.
        final: whether a row is the last of its trajectory [N]. terminated: whether nothing lies behind it [N].
        labels: Y [R, K], all that a learner is told about a trajectory.
        primitive: r [N], only for components that declare `sees_primitive` (the oracle); None for all others.
    """

    number: Tensor
    final: Tensor
    terminated: Tensor
    labels: Tensor
    primitive: Tensor | None = None

    @property
    def lengths(self) -> Tensor:
        """L [R, K], steps."""
        return self.sums(torch.ones_like(self.number)).to(self.labels.dtype)

    def to_steps(self, values: Tensor) -> Tensor:
        """What a trajectory has [R, K], for each of its steps [N]."""
        return values[self.replica, self.number]

    def sums(self, values: Tensor) -> Tensor:
        """Sums [R, K, ...] over the steps of each trajectory, of values [N, ...]."""
        replicas, count = self.labels.shape
        total = values.new_zeros(replicas * count, *values.shape[1:])
        return total.index_add_(0, self.replica * count + self.number, values).view(replicas, count, *values.shape[1:])


@dataclass(frozen=True)
class StepBelief(Belief):
    """What is believed of the reward of rows [1, ..., N], those of all replicas.

    Attributes:
        replica: of each row [N].
    """

    replica: Tensor

    def of(self, replica: int) -> StepBelief:
        """The rows of one replica."""
        own = self.replica == replica
        parts = {name: getattr(self, name)[..., own] for name in ("mean", "mse", "disagreement", "weights", "best")}
        parts |= {name: getattr(self, name)[..., own] for name in ("mixed", "plan", "replica")}
        return replace(self, bonus={name: values[..., own] for name, values in self.bonus.items()}, **parts)


class StepModel(RewardModel):
    """A reward model that predicts single steps, from what its feature map reads of them.

    Attributes:
        features: the feature map φ; rows of it are computed once, when their steps come.
    """

    domain: ClassVar = "continuous"
    features: FeatureMap

    @abstractmethod
    def start(self, problem: ContinuousProblem) -> None:
        """Make R empty fits, and start the feature map."""

    @abstractmethod
    def fit(self, inputs: Tensor, trajectories: Trajectories) -> None:
        """Fit all labels so far, from the last fit on.

        Args:
            inputs: φ of every row of the trajectories [N, d].

        Raises:
            RunError: the fit is not finite.
        """

    @abstractmethod
    def predict(self, inputs: Tensor, moves: Moves) -> tuple[Tensor, Tensor]:
        """Mean [N] and variance [N] of the pseudo-reward of rows, each by the fit of its replica.

        Args:
            inputs: φ of the rows [N, d]. moves: the rows, in any order; trajectories, or a grid to look at.
        """


class Scaler(Component):
    """How a pseudo-reward is scaled and clipped before a policy optimizer sees it. It decides continuous control."""

    domain: ClassVar = "continuous"

    @abstractmethod
    def __call__(self, rewards: Tensor) -> Tensor:
        """The scaled rewards [N] of one replica."""


class NetworkUncertainty(Uncertainty):
    """How far a neural reward model can be trusted: decides what is trained, and how it predicts."""

    domain: ClassVar = "continuous"

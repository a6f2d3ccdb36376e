"""The seams that only problems with real-valued states and actions have.

What is a table elsewhere is a column of rows here: one row a step, of all replicas together, in the order in which
trajectories came. The equations are the same functions, on [M, N] with N rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from torch import Tensor

from credit.core.component import Component
from credit.core.interfaces import FeatureMap, RewardModel, Uncertainty
from credit.core.state import Stateful
from credit.core.trajectories import ContinuousProblem, Moves, Trajectories
from credit.core.types import Belief
from credit.networks.stack import Stack


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


class Posterior(Stateful, ABC):
    """What the M networks of one neural model believe together; it decides what is trained, and how it predicts.

    Inputs are the networks' [M, rows, d], standardised; outputs are theirs too, before the model scales them.
    Networks are numbered replica by replica: those of replica r are r·E … r·E + E − 1.
    """

    def masks(self, rows: int) -> Sequence[Tensor]:
        """For one training step: what is kept of every hidden layer, zeros and ones [M, rows, width]; () for all."""
        return ()

    def offset(self, inputs: Tensor) -> Tensor | None:
        """What is added to the outputs in training [M, rows], if anything is; it stays as it is."""
        return None

    def fitted(self, inputs: Tensor, shares: Tensor) -> None:
        """Take note that the networks were fitted to sums of outputs.

        Args:
            inputs: those of K trajectories [M, K, P, d]. shares: the weight of every output in its sum [M, K, P].
        """

    @abstractmethod
    def predictor(self, replica: int) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
        """The prediction of one replica, with random numbers of its own: rows [n, d] → mean and variance [n]."""


class NetworkUncertainty(Uncertainty):
    """How far a neural reward model can be trusted. One component serves several models: each has a posterior.

    Attributes:
        members: E, networks that are trained for a replica.
    """

    domain: ClassVar = "continuous"
    members: int = 1

    @abstractmethod
    def posterior(self, networks: Stack, problem: ContinuousProblem, name: str) -> Posterior:
        """The posterior of a model of some name, on its R·E networks."""

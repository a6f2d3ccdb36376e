"""The seams that only problems with real-valued states and actions have.

What is a table elsewhere is a column of rows here: one row a step, of all replicas together, in the order in which
trajectories came. The equations are the same functions, on [M, N] with N rows.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

from torch import Tensor

from credit.component import Component
from credit.interfaces import FeatureMap, RewardModel, Uncertainty
from credit.trajectories import ContinuousProblem, Moves, Trajectories
from credit.types import Belief


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

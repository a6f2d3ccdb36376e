"""The seams that only tabular problems have: S states, A actions, and tables over what reward models look at."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import PAIRS, Axis
from credit.core.component import Component
from credit.core.dataset import Dataset
from credit.core.interfaces import CreditAssigner, RewardModel, Uncertainty
from credit.core.tensors import matvec
from credit.core.types import Estimate, Problem, Recovery, Windows


class CellModel(RewardModel):
    """A reward model of tabular problems: a table, with B draws of it.

    Attributes:
        looks_at: the axes that it reads; the pseudo-reward is a table over those of all models.
    """

    domain: ClassVar = "tabular"
    looks_at: Collection[Axis] = PAIRS

    @abstractmethod
    def start(self, problem: Problem, draws: int) -> None:
        """Make R × (1 + B) empty fits: the point fit and B draws."""

    @abstractmethod
    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Take in new windows with weights [R, K, 1+B] (the point fit's weight is 1)."""

    @abstractmethod
    def refit(self, windows: Windows, weights: Tensor) -> None:
        """Forget, and fit windows [R, K, T] with weights [R, K, 1+B]."""

    @abstractmethod
    def estimate(self, cells: Tensor | None = None) -> Estimate:
        """Predictions for some cells [R, n], or for all."""

    def looks(self, problem: Problem) -> Tensor:
        """A number [N] for every cell; unvisited cells with the same number must have the same prediction."""
        return torch.arange(problem.cells.count, device=problem.device)


class RidgeModel(CellModel):
    """A reward model with the confidence set of ridge regression."""

    @abstractmethod
    def leverage(self) -> Tensor:
        """φᵀV⁻¹φ of every cell [R, N], the squared width of the proof's confidence set (38)."""


class CellUncertainty(Uncertainty):
    """How the draws of all tables are made, and the variance of each model."""

    domain: ClassVar = "tabular"

    draws: int

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the streams of R replicas."""

    @abstractmethod
    def observe(self, models: list[CellModel], dataset: Dataset) -> None:
        """Show the newest windows to every model, all with the same weights."""

    @abstractmethod
    def variance(self, model: CellModel, estimate: Estimate) -> Tensor:
        """Var̂ r̂(s, a) [R, N] of one model."""

    @abstractmethod
    def prior(self, visits: Tensor) -> Tensor:
        """What is added to the reference's variance after N(s, a) visits [R, N]."""

    @abstractmethod
    def disagreement(self, reference: Estimate, surrogate: Estimate) -> Tensor:
        """Δ̂²(s, a) [R, N] of a surrogate, (7) or (9)."""

    def label_errors(self, estimates: list[Estimate], dataset: Dataset, columns: Tensor) -> Tensor:
        """Products [R, M, M] of the errors with which models predict labels that they were not fitted to, summed.

        Args:
            estimates: of all models. dataset: the windows. columns: where the estimates have each step [R, K, T].
        """
        raise NotImplementedError(f"{type(self).__name__} holds no labels out")


class TransitionModel(Component):
    """P̂ for planning."""

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the counts of R replicas."""

    @abstractmethod
    def observe(self, windows: Windows) -> None:
        """Count new transitions."""

    @abstractmethod
    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A] of values [R, S]."""


class TransitionTable(TransitionModel):
    """A transition model that is small enough to be written out."""

    @abstractmethod
    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]; rows sum to one, or to zero where nothing is known and nothing assumed."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A]."""
        probabilities = self.probabilities()
        return matvec(probabilities.flatten(1, 2), values).view(probabilities.shape[:-1])


class RewardFunction(CreditAssigner):
    """A credit assigner that knows a pseudo-reward for every cell, so that one can plan with it."""

    @abstractmethod
    def recovery(self) -> Recovery:
        """What is believed now."""

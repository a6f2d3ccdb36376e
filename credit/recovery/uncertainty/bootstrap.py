"""How far a fit can be trusted: the variance of each model and the gap between two of them."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from credit.core.dataset import Dataset
from credit.core.streams import Stream, generators
from credit.core.tables import CellModel, CellUncertainty
from credit.core.tensors import by_replica, grown
from credit.core.types import FLOAT, Estimate, NonNegative, NonNegativeInt, Positive, PositiveInt, Problem
from credit.recovery.models.linear import LinearModel


class Bootstrap(CellUncertainty):
    """Bootstrap over windows: B refits of every model on the same resampled windows (9)–(11).

    `poisson` gives each window, when it arrives, a Poisson(1) weight per draw and never touches it again: the online
    bootstrap, the same in distribution as resampling when there are many windows, at O(B) a window. `exact` resamples
    all K windows with replacement at every refit, as B.1 is written, at O(B·K).

    Args:
        draws: B, refits a model.
        resample: `poisson` or `exact`.
        ddof: 0 divides the variance by B, 1 by B − 1.
        prior_variance: τ², added to the reference's variance as τ²·n₀/(n₀ + N(s, a)): the bootstrap gives 0 where
            nothing was seen. 0 is the paper.
        prior_count: n₀, visits after which half of the prior variance is left.
    """

    domain: ClassVar = "tabular"
    keeps: ClassVar = ("_stream", "_outside", "_generators")

    def __init__(
        self,
        draws: PositiveInt = 20,
        resample: Literal["poisson", "exact"] = "poisson",
        ddof: NonNegativeInt = 0,
        prior_variance: NonNegative = 0.0,
        prior_count: Positive = 1.0,
    ) -> None:
        self.draws = draws
        self.resample = resample
        self.ddof = ddof
        self.prior_variance = prior_variance
        self.prior_count = prior_count

    def start(self, problem: Problem) -> None:
        """Make the weight streams."""
        self._problem = problem
        self._stream = Stream(problem, "bootstrap", "poisson", self.draws)
        self._outside = problem.zeros(256, self.draws) > 0  # whether a window has weight 0 in a draw [R, ≥ K, B]
        self._generators = generators(problem.seeds, "bootstrap/exact")

    def observe(self, models: list[CellModel], dataset: Dataset) -> None:
        """Weights for the newest windows (poisson) or for all of them (exact), the same for every model."""
        exact = self.resample == "exact"
        windows = dataset.windows if exact else dataset.new
        weights = self._multinomial(len(dataset)) if exact else self._poisson(windows.labels.shape[1])
        first, count = len(dataset) - weights.shape[1], len(dataset)
        if count > self._outside.shape[1]:
            self._outside = grown(self._outside, count)
        self._outside[:, first:count] = weights[..., 1:] == 0
        for model in models:
            (model.refit if exact else model.observe)(windows, weights)

    def variance(self, model: CellModel, estimate: Estimate) -> Tensor:
        """Variance over the draws (10)."""
        return by_replica(self._variance, estimate.draws)

    def _variance(self, draws: Tensor) -> Tensor:
        spread = draws - draws.mean(1, keepdim=True)  # torch.var is several times slower here
        return spread.square_().sum(1) / max(self.draws - self.ddof, 1)

    def prior(self, visits: Tensor) -> Tensor:
        """τ²·n₀/(n₀ + N(s, a))."""
        return self.prior_variance * self.prior_count / (self.prior_count + visits)

    def disagreement(self, reference: Estimate, surrogate: Estimate) -> Tensor:
        """Mean over the draws of the squared gap (9)."""
        return by_replica(lambda a, b: (a - b).square_().mean(1), reference.draws, surrogate.draws)

    def label_errors(self, estimates: list[Estimate], dataset: Dataset, columns: Tensor) -> Tensor:
        """Out of bag: each window is predicted by the mean of those draws in which it has weight 0."""
        windows = dataset.windows
        replicas, count, steps = windows.states.shape
        out = self._outside[:, :count].to(FLOAT)
        known = out.sum(-1).clamp(min=1)
        index = columns.flatten(1).unsqueeze(1)
        errors = []
        for estimate in estimates:
            each = estimate.draws.gather(2, index.expand(-1, self.draws, -1))
            predicted = each.view(replicas, self.draws, count, steps).sum(-1).mT
            errors.append(((predicted * out).sum(-1) / known - windows.labels) * (out.sum(-1) > 0))
        stacked = torch.stack(errors, dim=1)
        first = torch.eye(len(estimates), dtype=FLOAT, device=stacked.device)  # else the first windows decide too much
        return first + stacked @ stacked.mT

    def _poisson(self, windows: int) -> Tensor:
        ones = torch.ones(self._problem.replicas, 1, dtype=FLOAT, device=self._problem.device)
        rows = [torch.cat([ones, self._stream.next()], dim=1) for _ in range(windows)]
        return torch.stack(rows, dim=1)

    def _multinomial(self, windows: int) -> Tensor:
        even = np.full(windows, 1 / windows)
        drawn = np.stack([g.multinomial(windows, even, size=self.draws).T for g in self._generators])
        ones = np.ones((len(drawn), windows, 1))
        return torch.as_tensor(np.concatenate([ones, drawn], axis=-1), dtype=FLOAT, device=self._problem.device)


class Analytic(CellUncertainty):
    """The variance of ridge regression, σ²·φᵀV⁻¹φ, and the point gap (7); no refits.

    Args:
        noise: σ, standard deviation of a label given the truth, in units of reward.
    """

    needs: ClassVar = {"reference": LinearModel, "surrogates": LinearModel}
    keeps: ClassVar = ()

    def __init__(self, noise: Positive = 0.2) -> None:
        self.noise = noise
        self.draws = 0

    def start(self, problem: Problem) -> None:
        """Remember the shape of the weights."""
        self._problem = problem

    def observe(self, models: list[CellModel], dataset: Dataset) -> None:
        """Show the newest windows, each with weight one."""
        ones = torch.ones(*dataset.new.labels.shape, 1, dtype=FLOAT, device=self._problem.device)
        for model in models:
            model.observe(dataset.new, ones)

    def variance(self, model: CellModel, estimate: Estimate) -> Tensor:
        """σ²·φᵀV⁻¹φ [R, N]."""
        assert isinstance(model, LinearModel)
        return self.noise**2 * model.leverage()

    def prior(self, visits: Tensor) -> Tensor:
        """Zero: V⁻¹ starts at I/λ, which is its own prior."""
        return torch.zeros_like(visits)

    def disagreement(self, reference: Estimate, surrogate: Estimate) -> Tensor:
        """The squared gap of the point fits (7)."""
        return (reference.mean - surrogate.mean).square()

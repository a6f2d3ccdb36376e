"""How far a least-squares fit can be trusted: bootstrap over windows, or the variance of ridge regression."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegative, NonNegativeInt, Positive, PositiveInt
from credit.core.seams import Uncertainty
from credit.core.store import Store
from credit.core.streams import Queues, Stream, generators
from credit.core.tensors import grown
from credit.core.windows import Windows
from credit.recovery.proxies import spread

TINY = 1e-6  # a deviation that is smaller, as a part of the largest label, is rounding


def deviation(labels: Tensor, labelled: Tensor | None = None) -> Tensor:
    """The standard deviation [R] of labels [R, K], where there are any; 1 where all are the same."""
    if labelled is None:
        found = labels.std(1, correction=0)
    else:
        count = labelled.sum(1, keepdim=True).clamp(min=1)
        found = (
            torch.where(labelled, labels - labels.sum(1, keepdim=True) / count, 0).square().sum(1) / count[:, 0]
        ).sqrt()
    return torch.where(found > TINY * labels.abs().amax(1), found, 1.0)


def counted(weights: Tensor, windows: Windows) -> Tensor:
    """Weights [R, K, F], 0 for windows that have no label."""
    return weights if windows.labelled is None else weights * windows.labelled.unsqueeze(-1)


class Weights(NamedTuple):
    """How much each window counts in each of 1 + B fits; the point fit is the first.

    Attributes:
        values: [R, k, 1+B], of the newest k windows, or of all. anew: whether they are of all, and fits forget theirs.
    """

    values: Tensor
    anew: bool


class FitUncertainty(Uncertainty):
    """What a model that is fitted by weighted least squares asks for.

    Attributes:
        draws: B, further fits of every model, with other weights.
    """

    draws: int

    @abstractmethod
    def weights(self, store: Store) -> Weights:
        """Weights of windows, the same for all models that ask after the same append."""

    @abstractmethod
    def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
        """Var̂ r̂ [R, N].

        Args:
            draws: predictions [R, B, N]. leverage: gives φᵀV⁻¹φ [R, N]. residual: gives the mean squared error of the
                point fit's labels [R].
        """

    @property
    def sees_residuals(self) -> bool:
        """Whether the fit must keep account of how well it predicts its labels."""
        return False

    def prior(self, visits: Tensor) -> Tensor | float:
        """What is added to the reference's variance after N(s, a) visits [R, N]."""
        return 0.0

    def label_errors(self, estimates: Sequence[Estimate], store: Store, index: Tensor | None) -> Tensor:
        """Products [R, M, M] of the errors with which models predict labels that they were not fitted to, summed.

        In units of the variance of the labels, which is one where all are the same.

        Args:
            estimates: of all models. store: the windows. index: where the estimates have each row [R, n]; None where
                there are no windows.
        """
        raise NotImplementedError(f"{type(self).__name__} holds no labels out")


class Bootstrap(FitUncertainty):
    """Bootstrap over windows: B refits of every model on the same resampled windows (9)–(11).

    `poisson` gives each window, when it arrives, a Poisson(1) weight per draw and never touches it again, at O(B) a
    window: the online bootstrap. It is not the same as resampling: the weights of a draw do not sum to K, so that its
    spread is larger by O(1/K), and the draws of one refit are those of the one before with new windows added, not
    fresh ones. `exact` resamples all K windows with replacement at every refit, as B.1 is written, at O(B·K).

    Args:
        draws: B, refits a model.
        resample: `poisson` or `exact`.
        ddof: 0 divides the variance by B, 1 by B − 1.
        prior_variance: τ², added to the reference's variance as τ²·n₀/(n₀ + N(s, a)): the bootstrap gives 0 where
            nothing was seen. 0 is the paper.
        prior_count: n₀, visits after which half of the prior variance is left.
    """

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
        kind = Stream if problem.even else Queues
        self._stream: Stream | Queues = kind(problem, "bootstrap", "poisson", self.draws)
        self._outside = problem.zeros(256, self.draws) > 0  # whether a window has weight 0 in a draw [R, ≥ K, B]
        self._count = 0  # K
        self._generators = generators(problem.seeds, "bootstrap/exact")
        self._drawn: tuple[Windows, int, Weights] | None = None  # for which windows, after how many, and what

    def weights(self, store: Store) -> Weights:
        """Weights for the newest windows (poisson) or for all of them (exact)."""
        count, drawn = len(store), self._drawn
        if drawn is None or drawn[0] is not store.new or drawn[1] != count:
            anew = self.resample == "exact"
            windows = store.windows if anew else store.new
            values = counted(self._multinomial(windows) if anew else self._poisson(windows), windows)
            if count > self._outside.shape[1]:
                self._outside = grown(self._outside, count)
            self._outside[:, count - values.shape[1] : count] = values[..., 1:] == 0
            self._drawn = drawn = store.new, count, Weights(values, anew)
            self._count = count
        return drawn[2]

    def filled(self) -> Mapping[str, int]:
        """As many columns as windows."""
        return {"_outside": self._count}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Draw on from there."""
        super().load_state_dict(state)
        self._count = self._outside.shape[1]

    def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
        """Variance over the draws (10)."""
        return spread(draws, self.ddof)

    def prior(self, visits: Tensor) -> Tensor:
        """τ²·n₀/(n₀ + N(s, a))."""
        return self.prior_variance * self.prior_count / (self.prior_count + visits)

    def label_errors(self, estimates: Sequence[Estimate], store: Store, index: Tensor | None) -> Tensor:
        """Out of bag: each window is predicted by the mean of those draws in which it has weight 0."""
        count = len(store)
        if index is None or not count:
            return self._problem.zeros(len(estimates), len(estimates))
        windows = store.windows
        out = self._outside[:, :count].to(FLOAT)
        held = out.sum(-1) > 0 if windows.labelled is None else (out.sum(-1) > 0) & windows.labelled
        known = out.sum(-1).clamp(min=1)
        errors = []
        for estimate in estimates:
            assert estimate.draws is not None
            each = estimate.draws.gather(2, index.unsqueeze(1).expand(-1, self.draws, -1))
            if windows.length is None:
                predicted = windows.sums(each.mT)
            else:  # the sum of numbers that lie side by side
                predicted = each.unflatten(-1, (-1, windows.length)).sum(-1).mT
            if estimate.intercepts is not None:  # of bits, whose probability is compared
                predicted = (predicted + estimate.intercepts.unsqueeze(1)).sigmoid()
            errors.append(((predicted * out).sum(-1) / known - windows.labels) * held)
        stacked = torch.stack(errors, dim=1) / deviation(windows.labels, windows.labelled)[:, None, None]
        return stacked @ stacked.mT

    def _poisson(self, windows: Windows) -> Tensor:
        count = windows.labels.shape[1]
        values = torch.ones(self._problem.replicas, count, 1 + self.draws, dtype=FLOAT, device=self._problem.device)
        if isinstance(self._stream, Queues):
            values[:, :, 1:] = self._stream.take(windows.lengths > 0)
            return values
        for window in range(count):
            values[:, window, 1:] = self._stream.next()
        return values

    def _multinomial(self, windows: Windows) -> Tensor:
        count = windows.labels.shape[1]
        if not count:
            return self._problem.zeros(0, 1 + self.draws)
        found = np.ones((self._problem.replicas, count, 1 + self.draws))
        held = None if windows.labelled is None else windows.labelled.cpu().numpy()
        for replica, generator in enumerate(self._generators):
            own = slice(None) if held is None else held[replica]
            size = found[replica, own].shape[0]
            if size:
                drawn = generator.multinomial(size, np.full(size, 1 / size), size=self.draws)
                found[replica, own, 1:] = drawn.T
        return torch.as_tensor(found, dtype=FLOAT, device=self._problem.device)


class Analytic(FitUncertainty):
    """The variance of ridge regression, σ²·φᵀV⁻¹φ, and the point gap (7); no refits.

    Args:
        noise: σ, standard deviation of a label given the truth, in units of reward; null takes the root of the mean
            squared error with which the fit predicts its labels (4.1).
    """

    keeps: ClassVar = ()

    def __init__(self, noise: Positive | None = 0.2) -> None:
        self.noise = noise
        self.draws = 0

    def start(self, problem: Problem) -> None:
        """Remember the shape of the weights."""
        self._problem = problem

    def weights(self, store: Store) -> Weights:
        """One for each of the newest windows."""
        ones = torch.ones(*store.new.labels.shape, 1, dtype=FLOAT, device=self._problem.device)
        return Weights(counted(ones, store.new), anew=False)

    @property
    def sees_residuals(self) -> bool:
        """Only where σ is not given."""
        return self.noise is None

    def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
        """σ²·φᵀV⁻¹φ [R, N]."""
        return (residual().unsqueeze(-1) if self.noise is None else self.noise**2) * leverage()

"""How registered models are refitted here: by weights of units where they take weights, else to units drawn again."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.store import Store
from credit.logged.fits.units import Units, exponential
from credit.logged.panel import Floats, Ints
from credit.recovery.proxies import spread
from credit.recovery.uncertainty.bootstrap import FitUncertainty, Weights, counted
from credit.recovery.uncertainty.networks import Networks, NetworkUncertainty, Posterior, Predictor


class Weighed(FitUncertainty):
    """Refits with the weights that linear models have here (`Units.weights`), and so with common draws.

    Args:
        weights: of all windows, in their order [W, 1 + B].
    """

    keeps: ClassVar = ()

    def __init__(self, weights: Floats) -> None:
        self.draws = weights.shape[1] - 1
        self._values = torch.from_numpy(weights)[None]

    def weights(self, store: Store) -> Weights:
        """Of the newest windows."""
        count = store.new.labels.shape[1]
        return Weights(counted(self._values[:, len(store) - count : len(store)], store.new), anew=False)

    def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
        """Variance over the draws (10)."""
        return spread(draws)


class Single(NetworkUncertainty):
    """One network a replica, whose own uncertainty nobody asks for: replicas are the draws."""

    def posterior(self, networks: Networks, problem: Problem, name: str) -> Posterior:
        """It, alone."""
        return Alone(networks)


class Alone(Posterior):
    """Networks without an uncertainty of their own."""

    keeps: ClassVar = ()

    def __init__(self, networks: Networks) -> None:
        self._networks = networks

    def predictor(self, replica: int) -> Predictor:
        """The network's output."""

        def predict(rows: Tensor) -> tuple[Tensor, Tensor]:
            mean = self._networks.alone(replica, rows)
            return mean, torch.zeros_like(mean)

        return predict


def times(units: Units, of: Ints, draws: int, seed: int) -> Ints:
    """How often windows of units [w] are seen in the fit of all, once, and in each draw [w, 1 + B].

    A Poisson number of mean and variance 1, from the same uniform number as the unit's exponential weight: where linear
    models weigh a unit much, it is drawn often.
    """
    from scipy.special import pdtr

    uniform = -np.expm1(-exponential(units.key[of], draws, seed))
    found = np.ones((len(of), 1 + draws), dtype=np.int64)
    found[:, 1:] = np.searchsorted(pdtr(np.arange(20), 1.0), uniform)
    empty = ~found.any(0)  # of a handful of units
    found[:, empty] = 1
    return found

"""The paper's mixture on rows of a table: proxies, weights and disagreement (9)–(18), and the mixture of every draw.

A draw b of the mixture is what a mixture of its own fits would be: with its own gap, (r̂₀ᵇ − r̂_jᵇ)², about which draws
of its own would spread as those of the fits do, so that Δ̂²_j of draw b is that square plus the variance of the gap.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.fits.kernel import relative_mse_rows
from credit.logged.panel import Floats

if TYPE_CHECKING:
    from credit.core.seams import Mixer

CACHED = 400_000  # numbers that are looked at together
PREDICTED = 10_000  # rows of which registered models are asked together
# Of a design [n, F]: predictions [n, 1 + B], and by how much a variance is larger than that of these draws [n]
Predictor = Callable[[Floats], tuple[Floats, Floats]]
Theta = Floats | Predictor


@dataclass(frozen=True)
class Mixed:
    """What is believed of n rows.

    Attributes:
        credit: r̃ of the point fit [n]. deviation: its standard deviation over the draws [n]; 0 without draws.
        each: r̂ of each model [M, n]. weights: [M, n], they sum to one. disagreement: the signal (18) [n].
        draws: of r̃ [B, n], where they were asked for.
    """

    credit: Floats
    deviation: Floats
    each: Floats
    weights: Floats
    disagreement: Floats
    draws: Floats | None = None


def mixed(designs: Sequence[Floats], thetas: Sequence[Theta], mixer: Mixer, keep: bool = False) -> Mixed:
    """Mix the models' predictions of rows, a few rows at a time, on all processors that this process may use.

    Args:
        designs: φ of each model [n, d]. thetas: its coefficients, the point fit first [1 + B, d], or what predicts rows
            with such a φ. mixer: of proxies. keep: whether all draws of the mixture are returned.
    """
    count, fits = len(designs[0]), 1 + draws_of(thetas[0])
    plain = all(isinstance(theta, np.ndarray) for theta in thetas)
    at_once = max(1, CACHED // (fits * len(designs))) if plain else PREDICTED
    across = [np.ascontiguousarray(theta.T) if isinstance(theta, np.ndarray) else theta for theta in thetas]

    def of(first: int) -> Mixed:
        parts = [design[first : first + at_once] for design in designs]
        predictions, beyond = np.empty((len(parts), len(parts[0]), fits)), np.zeros((len(parts), len(parts[0])))
        for m, (part, theta) in enumerate(zip(parts, across, strict=True)):
            if isinstance(theta, np.ndarray):
                np.matmul(part, theta, out=predictions[m])
            else:
                predictions[m], beyond[m] = theta(part)
        return _mixed(predictions, beyond, mixer, keep)

    with _alone(), ThreadPoolExecutor(_processors() if plain else 1) as pool:
        parts = list(pool.map(of, range(0, count, at_once)))
    if not parts:
        parts = [_mixed(np.zeros((len(designs), 0, fits)), np.zeros((len(designs), 0)), mixer, keep)]
    return Mixed(
        np.concatenate([part.credit for part in parts]),
        np.concatenate([part.deviation for part in parts]),
        np.concatenate([part.each for part in parts], axis=1),
        np.concatenate([part.weights for part in parts], axis=1),
        np.concatenate([part.disagreement for part in parts]),
        np.concatenate([part.draws for part in parts if part.draws is not None], axis=1) if keep else None,
    )


@contextmanager
def _alone() -> Iterator[None]:
    """Matrix products on one thread each, since there are as many as processors already."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def draws_of(theta: Theta) -> int:
    """B."""
    return len(theta) - 1 if isinstance(theta, np.ndarray) else int(theta.draws)  # type: ignore[attr-defined]


def predicted(design: Floats, theta: Theta) -> Floats:
    """What all fits predict of rows [n, 1 + B]."""
    if isinstance(theta, np.ndarray):
        return design @ theta.T
    firsts = range(0, len(design), PREDICTED)
    parts = [theta(design[first : first + PREDICTED])[0] for first in firsts]
    return np.concatenate(parts) if parts else np.zeros((0, 1 + draws_of(theta)))


def summed(theta: Theta, here: Floats, there: Floats) -> Floats:
    """Σ over rows of what all fits predict more of the first than of the second [n, d]: [1 + B]."""
    if isinstance(theta, np.ndarray):
        return theta @ (here - there).sum(0)
    total = np.zeros(1 + draws_of(theta))
    for first in range(0, len(here), PREDICTED):
        own = slice(first, first + PREDICTED)
        total += (theta(here[own])[0] - theta(there[own])[0]).sum(0)
    return total


def _processors() -> int:
    """How many this process may use; not every system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _mixed(predictions: Floats, beyond: Floats, mixer: Mixer, keep: bool) -> Mixed:
    """Of predictions [M, n, 1 + B] whose variance is larger than that of their draws by so much [M, n]."""
    from credit.recovery.mixers import RelativeMSE

    models, _, fits = predictions.shape
    if models == 1:
        own = predictions[0]
        deviation = own[:, 1:].std(1) if fits > 1 else np.zeros(len(own))
        signal = np.sqrt(np.maximum(deviation**2 + beyond[0], 0))
        return Mixed(own[:, 0], deviation, own[None, :, 0], np.ones((1, len(own))), signal, own[:, 1:].T)
    if type(mixer) is not RelativeMSE or fits == 1 or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return of_tensors(predictions, mixer, beyond)
    draws = np.empty((predictions.shape[1], fits - 1)) if keep else None
    credit, deviation, weights, mse, between = relative_mse_rows(predictions, mixer.alpha, mixer.epsilon, draws, beyond)
    best = mse.argmin(0)
    signal = np.sqrt(np.concatenate([mse[:1], between])[best, np.arange(len(best))])
    each = np.ascontiguousarray(predictions[..., 0])
    return Mixed(credit, deviation, each, weights, signal, None if draws is None else draws.T)


def of_tensors(predictions: Floats, mixer: Mixer, beyond: Floats | None = None) -> Mixed:
    """The mixture of predictions [M, n, 1 + B] of two models or more by the paper's equations, for any mixer."""
    import torch

    from credit.recovery.bonuses import disagreement_signal
    from credit.recovery.mixers import best_model, mix

    every = torch.from_numpy(predictions)
    point, others = every[..., 0], every[..., 1:] if every.shape[-1] > 1 else every
    variance = others.var(-1, correction=0)
    if beyond is not None:
        variance = variance + torch.from_numpy(beyond)
    gaps = others[:1] - others[1:]
    between = gaps.square().mean(-1)
    mse = torch.cat([variance[:1], variance[1:] + between])
    weights = mixer.weights(mse)
    # Var of a gap, which its mean square holds, is what draws of a draw would add to the square of its own
    own = variance.unsqueeze(-1).repeat(1, 1, others.shape[-1])
    own[1:] += gaps.square() + gaps.var(-1, correction=0).unsqueeze(-1)
    draws = mix(mixer.weights(own.flatten(1)), others.flatten(1)).view(others.shape[1:])
    signal = disagreement_signal(mse, between, best_model(mse))
    found = (mix(weights, point), draws.std(-1, correction=0), point, weights, signal, draws.T)
    return Mixed(*(part.numpy() for part in found))

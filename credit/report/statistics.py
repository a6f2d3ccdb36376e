"""What may be said about scores from several seeds: pure functions on arrays, seeded, one source each.

Seeds are the replication unit everywhere: a seed is one independent run of one method on one task.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from credit.runs.intervals import CONFIDENCE, Array, Bounds, mean_interval

DRAWS = 10_000
ROUNDING = 1e-12  # differences of scores that are closer than this, as a share of the scores, are the same


class Interval(NamedTuple):
    """A value with its 95% interval; the ends are NaN where seeds leave no spread: one alone, or all the same."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside the interval; false where there is no interval."""
        return bool(self.low > 0 or self.high < 0)


def mean_and_error(scores: ArrayLike) -> tuple[float, float]:
    """Mean and standard error, s/√n with s² = Σ(x − x̄)²/(n − 1).

    Args:
        scores: [n] one score a seed.

    Returns:
        The mean and its standard error; the error is NaN for n = 1.
    """
    x = np.asarray(scores, dtype=float)
    return float(x.mean()), float(x.std(ddof=1) / np.sqrt(x.size)) if x.size > 1 else float("nan")


def pooled(amounts: ArrayLike, bases: ArrayLike) -> Array:
    """Scores whose mean is Σa/Σb and whose standard error is that of this ratio: R + (a − R b)/b̄ (linearised).

    Source: the ratio estimator of survey sampling, Cochran 1977, "Sampling techniques", section 6.4.

    Args:
        amounts: [n] a, one a seed.
        bases: [n] b, what each is a part of.

    Returns:
        [n] one score a seed; NaN where all bases are zero.
    """
    a, b = np.asarray(amounts, dtype=float), np.asarray(bases, dtype=float)
    if not b.any():
        return np.full_like(a, np.nan)
    ratio = a.sum() / b.sum()
    return np.asarray(ratio + (a - ratio * b) / b.mean())


def interquartile_mean(scores: ArrayLike) -> Array:
    """Mean of the middle half along the last axis: ⌊n/4⌋ scores are cut off at each end.

    Source: Agarwal et al. 2021, "Deep RL at the edge of the statistical precipice", section 4.3.

    Args:
        scores: [..., n].

    Returns:
        [...] the interquartile means.
    """
    x = np.sort(np.asarray(scores, dtype=float), axis=-1)
    cut = x.shape[-1] // 4
    return np.asarray(x[..., cut : x.shape[-1] - cut].mean(axis=-1))


def iqm_interval(scores: ArrayLike, *, draws: int = DRAWS, seed: int = 0) -> Interval:
    """Interquartile mean over all tasks and seeds with its stratified percentile bootstrap interval.

    Each draw takes seeds with replacement within every task, then pools the tasks.
    Source: Agarwal et al. 2021, section 4.1 (stratified bootstrap) and 4.3 (IQM).

    Args:
        scores: [tasks, n], or [n] for one task.
        draws: number of bootstrap samples.
        seed: of the resampling.

    Returns:
        The IQM and the 2.5% and 97.5% quantiles of its bootstrap distribution; the ends are NaN where the seeds of
        every task agree.
    """
    x = np.atleast_2d(np.asarray(scores, dtype=float))
    value = float(interquartile_mean(x.ravel()))
    if x.shape[1] < 2 or not np.ptp(x, axis=1).any():
        return Interval(value, float("nan"), float("nan"))
    chosen = np.random.default_rng(seed).integers(x.shape[1], size=(draws, *x.shape))
    samples = np.take_along_axis(x[None], chosen, axis=-1).reshape(draws, -1)
    return Interval(value, *_ends(interquartile_mean(samples)))


def pair_by_seed(
    seeds_x: ArrayLike, scores_x: ArrayLike, seeds_y: ArrayLike, scores_y: ArrayLike
) -> tuple[Array, Array]:
    """The scores of the seeds that both methods have, in the same order.

    Args:
        seeds_x: [n] the distinct seeds behind scores_x.
        scores_x: [n].
        seeds_y: [m] the distinct seeds behind scores_y.
        scores_y: [m].

    Returns:
        Two arrays [k] with k ≤ min(n, m) common seeds.
    """
    _, left, right = np.intersect1d(seeds_x, seeds_y, assume_unique=True, return_indices=True)
    return np.asarray(scores_x, dtype=float)[left], np.asarray(scores_y, dtype=float)[right]


def paired_difference(x: ArrayLike, y: ArrayLike, bounds: Bounds | None = None) -> Interval:
    """Mean of d = x − y over paired seeds with its 95% interval, d̄ ± t(n−1) s_d/√n, or within bounds.

    Source: the paired t-test (Student 1908). Pairing removes what the seed does to both methods alike.

    Args:
        x: [n] scores of a method.
        y: [n] scores of the reference, on the same seeds in the same order.
        bounds: between which a difference lies, as for rates.

    Returns:
        The mean difference and its interval; NaN throughout for n = 0. The ends are NaN where all seeds differ by the
        same: seeds of one mind leave no spread to measure.
    """
    d = np.asarray(x, dtype=float) - np.asarray(y, dtype=float)
    if d.size == 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    mean, low, high = mean_interval(d, bounds)
    if np.ptp(d) <= ROUNDING * max(np.abs(x).max(), np.abs(y).max()):
        return Interval(float(mean), float("nan"), float("nan"))
    return Interval(float(mean), float(low), float(high))


def probability_of_improvement(
    x: ArrayLike,
    y: ArrayLike,
    seeds_x: ArrayLike | None = None,
    seeds_y: ArrayLike | None = None,
    *,
    lower_is_better: bool = True,
    draws: int = DRAWS,
    seed: int = 0,
) -> Interval:
    """How often a run of X beats a run of Y: P(X < Y) + ½ P(X = Y) over all pairs of runs with different seeds.

    Over disjoint seeds this is the Mann–Whitney statistic U/(n·m). A seed does something to both methods alike, so
    that its own pair says nothing of two independent runs, and is left out. The bootstrap draws seeds with
    replacement, each with the runs that it has: a common seed brings both, and one of a single method is drawn among
    its like. Percentiles are expanded, Φ(−t √(n/(n−1))) instead of 2.5%, since a bootstrap of few is too narrow.
    Source: Agarwal et al. 2021, section 4.3; Mann and Whitney 1947; Hesterberg 2015, "What teachers should know about
    the bootstrap" (expanded percentiles).

    Args:
        x: [n] scores of a method.
        y: [m] scores of the reference.
        seeds_x: [n] the distinct seeds behind x. seeds_y: [m] those behind y; without them, no seed is common.
        lower_is_better: whether a lower score wins.
        draws: number of bootstrap samples.
        seed: of the resampling.

    Returns:
        The probability and its interval (½ means that neither is better), which is rough for fewer than ten seeds. NaN
        where no two runs have different seeds; the ends are NaN where a side has fewer than three seeds, or where all
        resamples agree, since a few seeds of one mind leave no spread to measure.

    Raises:
        ValueError: seeds are given for one side alone.
    """
    a, b = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if (seeds_x is None) != (seeds_y is None):
        raise ValueError("probability_of_improvement: give the seeds of both sides, or of neither")
    own = np.zeros((a.size, b.size), dtype=bool)
    if seeds_x is not None and seeds_y is not None:
        own = np.asarray(seeds_x)[:, None] == np.asarray(seeds_y)[None, :]
    sign = 1.0 if lower_is_better else -1.0
    wins = np.where(own, 0.0, np.heaviside(sign * (b[None, :] - a[:, None]), 0.5))
    if own.all():
        return Interval(float("nan"), float("nan"), float("nan"))
    value = float(wins.sum() / (~own).sum())
    if min(a.size, b.size) < 3:
        return Interval(value, float("nan"), float("nan"))
    # A resample is how often each seed was drawn, so all draws are two matrix products.
    left, right = np.nonzero(own)
    rng = np.random.default_rng(seed)
    drawn_a, drawn_b = (_drawn(rng, size, common, draws) for size, common in ((a.size, left), (b.size, right)))
    drawn_b[:, right] = drawn_a[:, left]
    pairs = a.size * b.size - (drawn_a[:, left] * drawn_b[:, right]).sum(axis=1)
    samples = ((drawn_a @ wins) * drawn_b).sum(axis=1)[pairs > 0] / pairs[pairs > 0]
    if samples.max() == samples.min():
        return Interval(value, float("nan"), float("nan"))
    n = min(a.size, b.size)
    tail = float(special.ndtr(-np.sqrt(n / (n - 1)) * special.stdtrit(n - 1, (1 + CONFIDENCE) / 2)))
    return Interval(value, *_ends(samples, tail))


def _drawn(rng: np.random.Generator, size: int, common: NDArray[np.intp], draws: int) -> Array:
    """How often each of `size` seeds is drawn [draws, size]: common ones among themselves, and so the others."""
    times = np.zeros((draws, size))
    for group in (common, np.setdiff1d(np.arange(size), common)):
        if group.size:
            times[:, group] = rng.multinomial(group.size, np.full(group.size, 1 / group.size), size=draws)
    return times


def count_trapped(scores: ArrayLike, above: float) -> int:
    """Number of seeds whose final regret lies above a threshold: runs that never found the good policy.

    Args:
        scores: [n] final regrets.
        above: the threshold, in the unit of the scores.

    Returns:
        How many scores exceed it.
    """
    return int((np.asarray(scores, dtype=float) > above).sum())


def _ends(samples: Array, tail: float = (1 - CONFIDENCE) / 2) -> tuple[float, float]:
    low, high = np.quantile(samples, [tail, 1 - tail])
    return float(low), float(high)


def wilson(successes: int, trials: int) -> Interval:
    """A rate with its score interval, which stays within [0, 1].

    Source: Wilson 1927, "Probable inference, the law of succession, and statistical inference".

    Args:
        successes: how many of the trials. trials: n ≥ 1, independent.
    """
    rate, z = successes / trials, float(special.ndtri((1 + CONFIDENCE) / 2))
    centre, scale = rate + z**2 / (2 * trials), 1 + z**2 / trials
    half = z * np.sqrt(rate * (1 - rate) / trials + (z / (2 * trials)) ** 2)
    low, high = float((centre - half) / scale), float((centre + half) / scale)
    return Interval(rate, max(0.0, min(low, rate)), min(1.0, max(high, rate)))  # to rounding they are beyond it

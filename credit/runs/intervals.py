"""Means over seeds with their 95% intervals, wherever they are shown, and which metrics are rates. Light: no torch."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

Array = NDArray[np.float64]
Bounds = tuple[float, float]

CONFIDENCE = 0.95
SHARE: Bounds = (0.0, 1.0)  # a rate lies here
GAP: Bounds = (-1.0, 1.0)  # and the difference of two rates here
POSITIVE: Bounds = (0.0, math.inf)  # a mean square error is never below 0
# What is never below 0 → what else the run has where that is so, if not always: the regret of steps that are taken may
# be, since they may earn more than g* does; that of a policy's value may not.
NEVER_NEGATIVE = {
    "reward/mse": "",
    "regret/share": "",
    "regret/cumulative": "regret/share",
    "regret/auc": "regret/share",
    "eval/length": "",
}


def is_rate(metric: str, rates: Mapping[str, str], known: Collection[str]) -> bool:
    """Whether a metric is a rate.

    Args:
        metric: its name.
        rates: what the judge of the run declares, `credit.core.seams.Judge.rates`.
        known: names of all metrics of the run.

    Example:
        >>> is_rate("policy/error_greedy", {"policy/error": ""}, ["policy/error_greedy"])
        True
    """
    for stem, needed in rates.items():
        if metric == stem or metric.startswith((f"{stem}_", f"{stem}/")):
            return not needed or needed in known
    return False


def bounds_of(metric: str, rates: Mapping[str, str], known: Collection[str]) -> Bounds | None:
    """Where means of a metric lie, if that is known.

    Args:
        metric, rates, known: as in `is_rate`.

    Example:
        >>> bounds_of("reward/mse", {}, ["reward/mse"])
        (0.0, inf)
    """
    if is_rate(metric, rates, known):
        return SHARE
    return POSITIVE if is_rate(metric, NEVER_NEGATIVE, known) else None


def mean_interval(values: ArrayLike, bounds: Bounds | None = None) -> tuple[Array, Array, Array]:
    """Mean and 95% interval over the first axis.

    Without bounds it is Student's, x̄ ± t(n−1) s/√n. Where what is averaged lies within bounds, it is Wilson's score
    interval, which does too: p = (x̄ − low)/(high − low), and in place of the count the effective one, p(1 − p)/se².
    Near the middle of the bounds, and for small errors, the two agree. Where there is a bound on one side alone,
    Student's interval ends there.
    Source: Wilson 1927; Dean and Pagano 2015, "Evaluating confidence interval methods for binomial proportions in
    clustered surveys" (the effective count, with t for the normal quantile).

    Args:
        values: [n, ...] one a seed.
        bounds: the least and the largest value that a mean can have; the latter may be infinite.

    Returns:
        Mean, lower and upper end, each [...]; the ends are NaN for n = 1.
    """
    x = np.asarray(values, dtype=float)
    mean = np.asarray(x.mean(axis=0))
    if len(x) < 2:
        return mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan)
    half = special.stdtrit(len(x) - 1, (1 + CONFIDENCE) / 2) * x.std(axis=0, ddof=1) / np.sqrt(len(x))
    if bounds is None:
        return mean, mean - half, mean + half
    low, high = bounds
    if math.isinf(high):
        return mean, np.maximum(mean - half, low), mean + half
    share, width = (mean - low) / (high - low), half / (high - low)
    spread = share * (1 - share)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(spread > 0, width**2 / spread, 0.0)  # t² over the effective count; no spread has no width
    middle = (share + ratio / 2) / (1 + ratio)
    reach = np.sqrt(ratio * np.maximum(spread, 0) + ratio**2 / 4) / (1 + ratio)
    ends = np.clip([middle - reach, middle + reach], 0, 1) * (high - low) + low  # beyond them is rounding alone
    return mean, ends[0], ends[1]

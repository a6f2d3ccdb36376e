"""The numbers of one row of a table, as columns: means, the interquartile mean, and what sets it apart from another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from credit.report import statistics
from credit.report.measures import REGRET, RETURN_ROUNDS, SUCCESS_ROUNDS, Measure
from credit.report.statistics import Interval

Columns = dict[str, float]


def contrasted(measures: tuple[Measure, ...]) -> tuple[Measure, ...]:
    """The measures of a table for which differences to the reference are taken, the primary one first."""
    return measures if measures[0] in (*SUCCESS_ROUNDS, *RETURN_ROUNDS) else measures[:1]


def scores_of(group: pd.DataFrame, measure: Measure) -> pd.DataFrame:
    """The seeds that know the measure, as columns seed and score."""
    if measure.per:
        known = group[["seed", measure.metric, measure.per]].dropna()
        return known.assign(score=statistics.pooled(known[measure.metric], known[measure.per])).dropna()
    known = group[["seed", measure.metric]].dropna()
    return known.rename(columns={measure.metric: "score"})


def mean_columns(group: pd.DataFrame, measure: Measure, reported: Mapping[str, tuple[float, float]]) -> Columns:
    """Mean, standard error and number of seeds, and what the paper reports.

    Args:
        group: the runs of the row. measure: which. reported: metric → mean and error in the paper.
    """
    scores = scores_of(group, measure)["score"]
    mean, error = statistics.mean_and_error(scores) if len(scores) else (float("nan"), float("nan"))
    columns = {
        f"{measure.metric}/mean": mean,
        f"{measure.metric}/se": error,
        f"{measure.metric}/n": len(scores),
    }
    if measure.metric in reported:
        columns[f"{measure.metric}/paper_mean"], columns[f"{measure.metric}/paper_se"] = reported[measure.metric]
    return columns


def primary_columns(group: pd.DataFrame, measure: Measure, trapped_above: float) -> Columns:
    """The interquartile mean, and of a regret the number of trapped seeds."""
    scores = scores_of(group, measure)["score"]
    if not len(scores):
        return {}
    found = statistics.iqm_interval(scores)
    if measure.bounds:  # a pooled share is linearised, and may leave them
        found = Interval(*(float(end) for end in np.clip(found, *measure.bounds)))
    columns = _interval("iqm", found)
    if measure.metric == REGRET.metric:
        columns["trapped"] = statistics.count_trapped(scores, trapped_above)
    return columns


def against(group: pd.DataFrame, base: pd.DataFrame, measure: Measure) -> Columns:
    """The difference to the reference, and how probable an improvement is."""
    ours, theirs = scores_of(group, measure), scores_of(base, measure)
    if not len(ours) or not len(theirs):
        return {}
    better = statistics.probability_of_improvement(
        ours["score"], theirs["score"], ours["seed"], theirs["seed"], lower_is_better=measure.lower_is_better
    )
    return difference(group, base, measure) | _interval("improvement", better)


def difference(group: pd.DataFrame, base: pd.DataFrame, measure: Measure, prefix: str = "") -> Columns:
    """The difference to the reference, paired by seed.

    Args:
        group, base: the runs of both. measure: which. prefix: of the columns.
    """
    common = set(scores_of(group, measure)["seed"]) & set(scores_of(base, measure)["seed"])
    # a pooled share is taken over the seeds that are compared
    ours, theirs = (scores_of(part[part["seed"].isin(common)], measure) for part in (group, base))
    x, y = statistics.pair_by_seed(ours["seed"], ours["score"], theirs["seed"], theirs["score"])
    found = statistics.paired_difference(x, y, measure.gap)
    return {**_interval(f"{prefix}difference", found), f"{prefix}difference_n": len(x)}


def _interval(name: str, interval: Interval) -> Columns:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}

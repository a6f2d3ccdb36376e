"""What an evaluation of kept policies comes to: a row a run, and what its intervals are over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from credit.report.statistics import Interval, wilson
from credit.runs.intervals import SHARE, mean_interval

FEW = 10  # seeds below which an interval over them is rough


def summary(found: pd.DataFrame) -> pd.DataFrame:
    """A row a run: seeds, episodes of each, and for each measure its mean, `_low` and `_high`.

    Several seeds are the unit, each by the mean of its episodes. One seed alone leaves its episodes, which tell how
    well this one policy is known, and nothing of what another seed would have learned. What is exact and of one seed
    has no interval.

    Args:
        found: what `credit.evaluate` gave.
    """
    rows = []
    for run, own in found.groupby("run", sort=False):
        seeds = own.groupby("seed").mean()
        row: dict[str, Any] = {"run": run, "seeds": len(seeds)}
        if "episode" in found.index.names:
            row["episodes"] = int(own.groupby("seed").size().max())
        for name in found.columns:
            interval = _interval(own[name].astype(float), seeds[name].astype(float))
            row |= {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
        rows.append(row)
    return pd.DataFrame(rows).set_index("run")


def _interval(episodes: pd.Series[float], seeds: pd.Series[float]) -> Interval:
    """Of seeds, where there are several, else of episodes; that of a rate lies in [0, 1]."""
    scores = (seeds if len(seeds) > 1 else episodes).dropna().to_numpy()
    rate = set(episodes.dropna().unique()) <= {0.0, 1.0}  # of an event, which each episode has or has not
    if rate and len(seeds) == 1 and len(scores) > 1:
        return wilson(int(scores.sum()), len(scores))
    if len(scores) < 2 or not np.ptp(scores):
        return Interval(float(scores.mean()) if len(scores) else float("nan"), float("nan"), float("nan"))
    mean, low, high = (float(value) for value in mean_interval(scores, SHARE if rate else None))
    return Interval(mean, low, high)


def caption(table: pd.DataFrame, exact: bool) -> Iterator[str]:
    """What the intervals of a summary are over, in lines."""
    several, one = table["seeds"] > 1, table["seeds"] == 1
    how = "each judged exactly" if exact else "each by the mean of its episodes"
    if several.any():
        yield f"in brackets: 95% intervals over seeds, {how}"
        if (table.loc[several, "seeds"] < FEW).any():
            yield f"fewer than {FEW} seeds: such an interval is rough"
    if one.any() and not exact:
        yield "of one seed: over its episodes; that says nothing of what another seed would have learned"
    if one.any() and exact:
        yield "of one seed, exactly: no interval, and nothing of what another seed would have learned"

"""From finished runs to one table of numbers, and the sentences that these numbers allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from credit.report import statistics
from credit.report.measures import REGRET, RETURN_ROUNDS, SUCCESS_ROUNDS, Measure, choose_curves, choose_measures
from credit.report.pointmaze.recognise import is_maze
from credit.report.published import PaperValues
from credit.report.runs import PAPER_METHODS, Runs
from credit.report.scale import Scale
from credit.report.settings import has
from credit.report.statistics import Interval

Row = dict[str, Any]


@dataclass(frozen=True)
class Comparison:
    """The numbers behind every rendering of the table, for one setting.

    Attributes:
        runs: what is compared.
        measures: the columns, the primary one first.
        table: one row a method and slug. For each measure `<metric>/mean`, `/se` and `/n`, with
            `/paper_mean` and `/paper_se` where the paper has them. For the primary one also iqm,
            difference and improvement, each with `_low` and `_high`, difference_n and trapped. For others that are
            contrasted, the columns of the difference with `<metric>/` before them.
        reference: (method, slug) of the row that the others are compared to, or None where it has no runs.
        reference_name: how that row is called in tables ("" without one).
        paper: the paper's values, or None.
        trapped_above: the regret above which a seed counts as trapped.
    """

    runs: Runs
    measures: tuple[Measure, ...]
    table: pd.DataFrame
    reference: tuple[str, str] | None
    reference_name: str
    paper: PaperValues | None
    trapped_above: float

    @property
    def primary(self) -> Measure:
        """The measure that the methods are compared by."""
        return self.measures[0]

    @property
    def contrasted(self) -> tuple[Measure, ...]:
        """The measures for which differences to the reference are known, the primary one first."""
        return _contrasted(self.measures)

    @property
    def curves(self) -> tuple[Measure, ...]:
        """The measures that are drawn over time."""
        return choose_curves(self.runs.metrics, self.measures)

    @property
    def trajectory(self) -> int | None:
        """Steps of a trajectory where curves count those, in a maze: every window has the length of the horizon."""
        return self.runs.window if self.is_maze else None

    @cached_property
    def is_maze(self) -> bool:
        """Whether the runs have a maze, which can be drawn."""
        return is_maze(self.runs.frame)

    @property
    def rows(self) -> list[Row]:
        """The rows of the table, each as column → value (NaN where the table has none)."""
        return [{str(key): value for key, value in row.items()} for row in self.table.to_dict("records")]

    @property
    def counts_trapped(self) -> bool:
        """Whether the primary measure is a regret in steps, in which a seed can be trapped."""
        return "trapped" in self.table

    def is_reference(self, row: Row) -> bool:
        """Whether a row is the one that the others are compared to."""
        return (row["method"], row["slug"]) == self.reference

    def scale(self, measure: Measure) -> Scale:
        """How a measure's column is printed."""
        return Scale.of(self.table[f"{measure.metric}/mean"], self.table[f"{measure.metric}/se"])

    def difference_column(self, measure: Measure) -> str:
        """The column of a measure's difference to the reference, for `interval_of`."""
        return "difference" if measure == self.primary else f"{measure.metric}/difference"

    @property
    def metrics(self) -> dict[str, float]:
        """Every known number of the table as `<method>/<column>`, variants as `<method>/<slug>/<column>`."""
        flat = {}
        for row in self.rows:
            prefix = row["method"] if row["slug"] == "default" else f"{row['method']}/{row['slug']}"
            for column, value in row.items():
                if isinstance(value, int | float) and pd.notna(value) and not column.startswith("seed_"):
                    flat[f"{prefix}/{column}"] = float(value)
        return flat


def metrics_of(comparisons: Sequence[Comparison]) -> dict[str, float]:
    """Every known number of a report: `Comparison.metrics`, with `<setting>/` before it where there are several."""
    if len(comparisons) == 1:
        return comparisons[0].metrics
    return {f"{part.runs.setting.name}/{name}": value for part in comparisons for name, value in part.metrics.items()}


def interval_of(row: Row, name: str) -> Interval:
    """The columns `name`, `name_low` and `name_high` of a row; NaN where the table has none."""
    return Interval(*(float(row.get(name + end, float("nan"))) for end in ("", "_low", "_high")))


def ordered_groups(runs: Runs) -> list[tuple[str, str, pd.DataFrame]]:
    """The runs of each (method, slug), the paper's methods first and in the paper's order."""

    def position(key: tuple[str, str]) -> tuple[int, str, bool, str]:
        """What to sort by."""
        method, slug = key
        # What goes beyond the paper follows by name.
        rank = PAPER_METHODS.index(method) if method in PAPER_METHODS else len(PAPER_METHODS)
        return rank, method, slug != "default", slug

    groups = {(str(m), str(s)): group for (m, s), group in runs.frame.groupby(["method", "slug"])}
    return [(*key, groups[key]) for key in sorted(groups, key=position)]


def display_name(group: pd.DataFrame) -> str:
    """The method's name as tables show it, with its slug where it is a variant."""
    name, slug = str(group["name"].iloc[0]), str(group["slug"].iloc[0])
    return name if slug == "default" else f"{name} ({slug})"


def summarise(
    runs: Runs,
    *,
    reference: str = "reference",
    trapped_above: float = 300.0,
    paper: PaperValues | None = None,
    metric: str | None = None,
) -> Comparison:
    """Compute the comparison table.

    Args:
        runs: finished runs of one setting.
        reference: the method that the others are compared to; its default variant where it has several.
        trapped_above: final regret above which a seed counts as trapped.
        paper: the paper's values; they are left out where they belong to another setting.
        metric: by which methods are ranked; None for what their judge ranks by.

    Returns:
        The comparison; metrics that no run knows are left out.

    Raises:
        UserError: no run has a metric that methods can be compared by.
        ValueError: the runs are of several settings, which have nothing to be compared by.
    """
    if runs.frame["setting"].nunique() > 1:
        raise ValueError("summarise: runs of several settings; take those of one, from Runs.by_setting()")
    measures = choose_measures(runs.metrics, runs.experiment, metric)
    groups = ordered_groups(runs)
    if paper is not None and not has(runs.frame["setting"].iloc[0], paper.setting):
        paper = None
    base = next((entry for entry in groups if entry[0] == reference), None)
    rows = []
    for method, slug, group in groups:
        row: Row = {
            "method": method,
            "slug": slug,
            "name": display_name(group),
            "seed_first": int(group["seed"].min()),
            "seed_last": int(group["seed"].max()),
            "n": len(group),
        }
        reported = paper.methods.get(method, {}) if paper and slug == "default" else {}
        for measure in measures:
            row |= _mean_columns(group, measure, reported)
        row |= _primary_columns(group, measures[0], trapped_above)
        if base is not None and (method, slug) != base[:2]:
            row |= _against(group, base[2], measures[0])
            for measure in _contrasted(measures)[1:]:
                row |= _difference(group, base[2], measure, f"{measure.metric}/")
        rows.append(row)
    return Comparison(
        runs=runs,
        measures=measures,
        table=pd.DataFrame(rows),
        reference=base[:2] if base else None,
        reference_name=display_name(base[2]) if base else "",
        paper=paper,
        trapped_above=trapped_above,
    )


def _mean_columns(
    group: pd.DataFrame, measure: Measure, reported: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    scores = _scores(group, measure)["score"]
    mean, error = statistics.mean_and_error(scores) if len(scores) else (float("nan"), float("nan"))
    columns = {
        f"{measure.metric}/mean": mean,
        f"{measure.metric}/se": error,
        f"{measure.metric}/n": len(scores),
    }
    if measure.metric in reported:
        columns[f"{measure.metric}/paper_mean"], columns[f"{measure.metric}/paper_se"] = reported[measure.metric]
    return columns


def _primary_columns(group: pd.DataFrame, measure: Measure, trapped_above: float) -> dict[str, float]:
    scores = _scores(group, measure)["score"]
    if not len(scores):
        return {}
    columns = _columns("iqm", statistics.iqm_interval(scores))
    if measure == REGRET:
        columns["trapped"] = statistics.count_trapped(scores, trapped_above)
    return columns


def _against(group: pd.DataFrame, base: pd.DataFrame, measure: Measure) -> dict[str, float]:
    ours, theirs = _scores(group, measure), _scores(base, measure)
    if not len(ours) or not len(theirs):
        return {}
    better = statistics.probability_of_improvement(
        ours["score"], theirs["score"], ours["seed"], theirs["seed"], lower_is_better=measure.lower_is_better
    )
    return _difference(group, base, measure) | _columns("improvement", better)


def _difference(group: pd.DataFrame, base: pd.DataFrame, measure: Measure, prefix: str = "") -> dict[str, float]:
    common = set(_scores(group, measure)["seed"]) & set(_scores(base, measure)["seed"])
    # a pooled share is taken over the seeds that are compared
    ours, theirs = (_scores(part[part["seed"].isin(common)], measure) for part in (group, base))
    x, y = statistics.pair_by_seed(ours["seed"], ours["score"], theirs["seed"], theirs["score"])
    return {**_columns(f"{prefix}difference", statistics.paired_difference(x, y)), f"{prefix}difference_n": len(x)}


def _contrasted(measures: tuple[Measure, ...]) -> tuple[Measure, ...]:
    return measures if measures[0] in (*SUCCESS_ROUNDS, *RETURN_ROUNDS) else measures[:1]


def _scores(group: pd.DataFrame, measure: Measure) -> pd.DataFrame:
    """The seeds that know the measure, as columns seed and score."""
    if measure.per:
        known = group[["seed", measure.metric, measure.per]].dropna()
        return known.assign(score=statistics.pooled(known[measure.metric], known[measure.per])).dropna()
    known = group[["seed", measure.metric]].dropna()
    return known.rename(columns={measure.metric: "score"})


def _columns(name: str, interval: Interval) -> dict[str, float]:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}

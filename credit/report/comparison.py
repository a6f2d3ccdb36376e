"""From finished runs to one table of numbers, and the sentences that these numbers allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import pandas as pd

from credit.report.columns import against, contrasted, difference, mean_columns, primary_columns, scores_of
from credit.report.groups import Group, Key, Reference, best_first, choose_reference, display_name, ordered_groups
from credit.report.measures import Measure, choose_curves, choose_measures, known_measure
from credit.report.pointmaze.recognise import is_maze
from credit.report.published import PaperValues
from credit.report.runs import Runs
from credit.report.scale import Scale
from credit.report.settings import has
from credit.report.statistics import Interval

Row = dict[str, Any]
LONGEST = 40  # letters of a row that is named in headers and sentences


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
        reference: the row that the others are compared to, if any, and what is to be said of the choice.
        reference_name: how that row is called in headers and sentences, `the reference` where its name is long, ""
            where there is none.
        left_out: how many rows of the runs that were found are not shown, since only the best were asked for.
        paper: the paper's values, or None.
        trapped_above: the regret above which a seed counts as trapped.
    """

    runs: Runs
    measures: tuple[Measure, ...]
    table: pd.DataFrame
    reference: Reference
    reference_name: str
    paper: PaperValues | None
    trapped_above: float
    left_out: int = 0

    @property
    def primary(self) -> Measure:
        """The measure that the methods are compared by."""
        return self.measures[0]

    @property
    def contrasted(self) -> tuple[Measure, ...]:
        """The measures for which differences to the reference are known, the primary one first."""
        return contrasted(self.measures)

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
    def groups(self) -> list[Group]:
        """The runs of each row of the table, in its order."""
        groups = {(method, slug): group for method, slug, group in ordered_groups(self.runs.frame)}
        return [(*key, groups[key]) for key in zip(self.table["method"], self.table["slug"], strict=True)]

    @property
    def counts_trapped(self) -> bool:
        """Whether the primary measure is a regret in steps, in which a seed can be trapped."""
        return "trapped" in self.table

    def is_reference(self, row: Row) -> bool:
        """Whether a row is the one that the others are compared to."""
        return (row["method"], row["slug"]) == self.reference.key

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


def summarise(
    runs: Runs,
    *,
    reference: str | None = None,
    trapped_above: float = 300.0,
    paper: PaperValues | None = None,
    metric: str | None = None,
    sort: str | None = None,
    best: int | None = None,
) -> Comparison:
    """Compute the comparison table.

    Args:
        runs: finished runs of one setting.
        reference: what the others are compared to, as `credit.report.groups.choose_reference` reads it.
        trapped_above: final regret above which a seed counts as trapped.
        paper: the paper's values; they are left out where they belong to another setting.
        metric: by which methods are ranked; None for what their judge ranks by.
        sort: order rows by this metric, the best first; None for the paper's order, or by `metric` with `best`.
        best: only so many rows, the best by `metric`, and the reference.

    Returns:
        The comparison; metrics that no run knows are left out.

    Raises:
        UserError: no run has a metric that methods can be compared or sorted by, or the reference names several rows.
        ValueError: the runs are of several settings, which have nothing to be compared by.
    """
    if runs.frame["setting"].nunique() > 1:
        raise ValueError("summarise: runs of several settings; take those of one, from Runs.by_setting()")
    measures = choose_measures(runs.metrics, runs.experiment, metric)
    groups = {(method, slug): group for method, slug, group in ordered_groups(runs.frame)}
    if paper is not None and not has(runs.frame["setting"].iloc[0], paper.setting):
        paper = None
    ranking = _ranked(groups, measures[0])
    chosen = choose_reference([(*key, group) for key, group in groups.items()], reference, ranking)
    base = groups[chosen.key] if chosen.key else None
    by = known_measure("sort", sort, runs.metrics) if sort else measures[0]
    order = _ranked(groups, by) if sort or best else list(groups)
    shown = {*ranking[:best], *([chosen.key] if chosen.key else [])}
    rows = []
    for key in (key for key in order if key in shown):
        method, slug, group = *key, groups[key]
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
            row |= mean_columns(group, measure, reported)
        row |= primary_columns(group, measures[0], trapped_above)
        if base is not None and key != chosen.key:
            row |= against(group, base, measures[0])
            for measure in contrasted(measures)[1:]:
                row |= difference(group, base, measure, f"{measure.metric}/")
        rows.append(row)
    kept = [key in shown for key in zip(runs.frame["method"], runs.frame["slug"], strict=True)]
    return Comparison(
        runs=replace(runs, frame=runs.frame[kept].reset_index(drop=True)),
        measures=measures,
        table=pd.DataFrame(rows),
        reference=chosen,
        reference_name="" if base is None else name if len(name := display_name(base)) <= LONGEST else "the reference",
        paper=paper,
        trapped_above=trapped_above,
        left_out=len(groups) - len(shown),
    )


def _ranked(groups: Mapping[Key, pd.DataFrame], measure: Measure) -> list[Key]:
    means = {key: float(scores_of(group, measure)["score"].mean()) for key, group in groups.items()}
    return best_first(groups, means, measure.lower_is_better)

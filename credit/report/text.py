"""The words around the tables: what the columns are, and what the data show or do not show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from credit.report.comparison import Comparison, interval_of
from credit.report.groups import several_titles
from credit.report.measures import AUC, AUC_OF_RETURN, Measure
from credit.report.provenance import differing_code
from credit.report.runs import Runs
from credit.report.settings import common_values, describe

FEW = 10  # seeds below which intervals are rough
_KINDS = {True: "score interval (of rates)", False: "t-interval"}


def heading(runs: Runs) -> str:
    """The setting as one would type it; empty where it has no name."""
    return runs.setting.words


def in_common(*comparisons: Comparison) -> str:
    """The problem and the budget that all runs of a report share, in one line."""
    settings = {str(comparison.runs.frame["setting"].iloc[0]) for comparison in comparisons}
    return f"In common: {describe(common_values(settings)) or 'nothing'}."


def span(numbers: Iterable[int]) -> str:
    """`5`, or `3–5` where they differ; empty without any."""
    ends = sorted({*numbers})
    return "–".join(str(end) for end in dict.fromkeys(ends[:1] + ends[-1:]))


def remarks(comparison: Comparison) -> list[str]:
    """What sets these runs apart from others, and whether they may stand in one table at all."""
    own, frame = describe(comparison.runs.setting.own), comparison.runs.frame
    return [*([f"Here: {own}."] if own else []), *filter(None, [differing_code(frame), several_titles(frame)])]


def caption(*comparisons: Comparison) -> str:
    """What the columns mean, in one paragraph of plain text for all settings."""
    return "; ".join(dict.fromkeys(part for comparison in comparisons for part in _explained(comparison))) + "."


def sentences(comparison: Comparison) -> list[str]:
    """What may be said about the differences to the reference, and what was left out."""
    lines = [*remarks(comparison), *_chosen(comparison), *_differences(comparison)]
    for row in comparison.rows:
        for measure in comparison.measures:
            known = row[f"{measure.metric}/n"]
            if 0 < known < row["n"]:
                lines.append(f"{measure.title} of {row['name']} is known for {known} of {row['n']} seeds only.")
    if unfinished := len(comparison.runs.unfinished):
        lines.append(f"{unfinished} unfinished {'run was' if unfinished == 1 else 'runs were'} left out.")
    return lines


def _chosen(comparison: Comparison) -> list[str]:
    """Which rows are shown, what they are compared to, and from how few seeds."""
    lines = []
    if left := comparison.left_out:
        lines.append(
            f"Shown are the best by {comparison.primary.title.lower()}, {left} {'row is' if left == 1 else 'rows are'} "
            "left out: the same seeds chose them, which flatters them."
        )
    if comparison.reference.remark:
        lines.append(comparison.reference.remark)
    elif comparison.reference.key and not any(row["name"] == comparison.reference_name for row in comparison.rows):
        lines += [f"The reference is {row['name']}." for row in comparison.rows if comparison.is_reference(row)]
    seeds = span(int(row["n"]) for row in comparison.rows if 1 < row["n"] < FEW)
    if seeds:
        lines.append(f"Few seeds ({seeds}): an interval from fewer than {FEW} is rough.")
    return lines


def _kind(comparison: Comparison) -> str:
    """How intervals of differences are made."""
    return " or ".join(dict.fromkeys(_KINDS[measure.rate] for measure in comparison.contrasted))


def _explained(comparison: Comparison) -> list[str]:
    parts = ["± is one standard error over seeds"]
    if comparison.paper:
        parts.append(f"[mean ± s.e.] is from {comparison.paper.source}, {comparison.paper.seeds} seeds")
    parts.append("IQM is the interquartile mean with a 95% bootstrap interval over seeds")
    if comparison.reference.key:
        direction = "lower" if comparison.primary.lower_is_better else "higher"
        parts.append(
            f"differences to {comparison.reference_name} are paired by seed, with a 95% {_kind(comparison)}; "
            f"P(improvement) is the probability that a run of the method has the {direction} "
            f"{comparison.primary.title.lower()} of two runs with different seeds, with a 95% bootstrap interval over "
            "seeds, each with the runs of both methods where it has both"
        )
    if comparison.counts_trapped:
        parts.append(f"trapped seeds end with a regret above {comparison.trapped_above:g}")
    shown = {measure.metric: measure for measure in comparison.measures}
    if auc := shown.get(AUC.metric):
        parts.append(f"AUC is the {auc.axis.lower().removesuffix(' over the rounds')} over all rounds")
    if "eval/lost" in shown:
        parts.append(
            "lost rounds are those with a success rate below .6 after a round with .9 or more, as a share of all after "
            "such a round, pooled over seeds"
        )
    if any(metric.endswith("_averaged") for metric in shown):
        parts.append("the averaged actor has a moving average of the policy's weights and is only evaluated")
    return parts


def _differences(comparison: Comparison) -> list[str]:
    if comparison.reference.key is None:
        return []
    told = [comparison.primary, *({AUC, AUC_OF_RETURN} & set(comparison.contrasted[1:]))]
    lines = [line for measure in told for line in _verdicts(comparison, measure)] + _without(comparison, told)
    apart = [row["name"] for row in comparison.rows if row.get("difference_n") == 0]
    if apart:
        lines.append(
            f"No seed is common to {comparison.reference_name} and {', '.join(apart)}: nothing is paired, and "
            "P(improvement) takes their seeds as independent."
        )
    if any(pd.notna(interval_of(row, "difference").low) for row in comparison.rows):
        lines.append("Each interval holds at 95% on its own; none is corrected for the number of comparisons.")
    return lines


def _verdicts(comparison: Comparison, measure: Measure) -> list[str]:
    scale, column = comparison.scale(measure), comparison.difference_column(measure)
    found: dict[str, list[str]] = {"lower": [], "higher": [], "open": []}
    for row in comparison.rows:
        difference = interval_of(row, column)
        if comparison.is_reference(row) or pd.isna(difference.low):
            continue
        verdict = ("lower" if difference.value < 0 else "higher") if difference.excludes_zero else "open"
        numbers = " ".join(scale.interval(difference, signed=True))
        found[verdict].append(f"{row['name']} {numbers}, n = {row[column + '_n']:.0f}")
    title, name = measure.title + scale.unit, comparison.reference_name
    openings = {
        "lower": f"{title} is lower than that of {name}, the interval excludes zero",
        "higher": f"{title} is higher than that of {name}, the interval excludes zero",
        "open": f"{title} is not shown to differ from that of {name}, the interval includes zero",
    }
    return [f"{openings[verdict]}: {'; '.join(names)}." for verdict, names in found.items() if names]


def _without(comparison: Comparison, told: Sequence[Measure]) -> list[str]:
    """Which rows have no interval and why, once for all measures of which the same is true."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in comparison.rows:
        for measure in told:
            column = comparison.difference_column(measure)
            if comparison.is_reference(row) or pd.notna(interval_of(row, column).low):
                continue
            alike = row.get(f"{column}_n", 0) > 1
            why = "common seeds all differ by the same" if alike else "fewer than two common seeds"
            found.setdefault((why, row["name"]), []).append(measure.title)
    lines: dict[tuple[str, str], list[str]] = {}
    for (why, name), titles in found.items():
        of = "" if len(titles) == len(told) else f" in {' and '.join(titles)}"
        lines.setdefault((of, why), []).append(name)
    against = comparison.reference_name
    return [f"No interval against {against}{of}, {why}: {'; '.join(names)}." for (of, why), names in lines.items()]

"""Curves over time and the spread of final scores, a panel a setting."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from credit.report import statistics, style
from credit.report.comparison import Comparison, display_name, interval_of, ordered_groups
from credit.report.measures import AVERAGED, AVERAGED_WORTH, SUCCESS, WORTH, Measure
from credit.report.runs import load_curves
from credit.report.text import heading

Array = statistics.Array
Key = tuple[str, str]  # method and slug

COLUMNS = 2  # panels side by side
POLICIES = {SUCCESS: "Current actor", AVERAGED: "Averaged actor"}
POLICIES |= {WORTH: "Current actor", AVERAGED_WORTH: "Averaged actor"}
TRAJECTORIES = "Online trajectories after the demonstrations"
POINTS = "points: seeds; circle and bar: interquartile mean, 95% interval"


@dataclass(frozen=True)
class Look:
    """How a method and slug is called and drawn, in every panel."""

    name: str
    colour: str
    dashes: object


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of the curves figure: steps (in a maze, trajectories) [L], mean and 95% interval [L] over seeds."""

    look: Look
    recovers: bool
    steps: Array
    mean: Array
    low: Array
    high: Array

    @property
    def ceiling(self) -> float:
        """The largest value that is drawn."""
        return float(np.nanmax(np.append(self.high, self.mean)))

    @property
    def label(self) -> tuple[float, str, str]:
        """Height, name and colour of what is written beside the line's end."""
        return float(self.mean[-1]), _two_lines(self.look.name), self.look.colour


def curves_figure(comparisons: Sequence[Comparison]) -> Figure | None:
    """Mean and 95% interval over seeds of a metric against primitive steps (the paper's Figures 2 and 3).

    Of one setting the left panel holds all methods; where those that recover a reward lie close together at its
    foot, a second panel enlarges their range. Of several, each has a panel. In a maze the axis counts trajectories, and
    each policy that is evaluated has a panel (Figure 4).

    Args:
        comparisons: one a setting.

    Returns:
        The figure, or None where no run has a curve.
    """
    looks = _looks(comparisons)
    every = [(comparison, measure) for comparison in comparisons for measure in comparison.curves]
    drawn = [(*panel, lines) for panel in every if (lines := _curves(*panel, looks))]
    if not drawn:
        return None
    if len(every) == 1 and every[0][1] not in POLICIES:
        figure = _one_setting(*drawn[0])
    else:
        letters = _letters(_two_lines(look.name) for look in looks.values())
        figure, panels = _panels(len(drawn), 4.0 + 0.07 * letters, 4.1)
        for panel, (comparison, measure, lines) in zip(panels, drawn, strict=True):
            rate = measure in (SUCCESS, AVERAGED)
            top = 1.02 if rate else 1.04 * max(line.ceiling for line in lines)
            _draw(panel, lines, measure, (0.0 if rate else _floor(lines), top))
            style.label_ends(panel, [line.label for line in lines])
            policy = POLICIES.get(measure, "")
            panel.set_title(": ".join(filter(None, [heading(comparison.runs), policy])))
    units = ["Primitive environment steps" if part.trajectory is None else TRAJECTORIES for part in comparisons]
    figure.supxlabel(f"{' or '.join(dict.fromkeys(units))} (mean over seeds and 95% interval)", fontsize=9)
    return figure


def distribution_figure(comparisons: Sequence[Comparison]) -> Figure:
    """Every seed's final score as a point, with the interquartile mean and its 95% interval.

    Args:
        comparisons: one a setting; its primary measure is drawn.
    """
    looks = _looks(comparisons)
    scored = {key for comparison in comparisons for key in _scores(comparison)}
    places = {key: place for place, key in enumerate(key for key in looks if key in scored)}
    names = [_two_lines(looks[key].name) for key in places]
    one = len(comparisons) == 1
    width = 7.2 if one else 5.2
    figure, panels = _panels(len(comparisons), width, 1.1 + 0.42 * len(places), sharey=True)
    for panel, comparison in zip(panels, comparisons, strict=True):
        remark = _draw_scores(panel, comparison, looks, places)
        panel.set_title(heading(comparison.runs), pad=16 if comparison.counts_trapped else None)
        remarks = "; ".join([*([POINTS] if one else []), *([remark] if remark else [])])
        label = f"{comparison.primary.title} ({remarks})" if remarks else comparison.primary.title
        if 0.06 * len(label) > width - 0.075 * _letters(names):  # inches; a label is centred below its panel
            label = label.replace(" (", "\n(", 1)
        panel.set_xlabel(label)
    panels[0].set_yticks(range(len(places)), names)
    panels[0].set_ylim(len(places) - 0.5, -0.6)
    if not one:
        figure.supxlabel(POINTS.capitalize(), fontsize=8)
    return figure


def _panels(number: int, width: float, height: float, *, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    columns = min(number, COLUMNS)
    rows = -(-number // columns)
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=sharey, squeeze=False).ravel()
    for panel in panels[number:]:
        panel.set_visible(False)
    return figure, list(panels[:number])


def _one_setting(comparison: Comparison, measure: Measure, lines: list[Curve]) -> Figure:
    top = max(line.ceiling for line in lines)
    inner = [line.ceiling for line in lines if line.recovers]
    zoomed = bool(inner) and len(inner) < len(lines) and max(inner) < 0.5 * top
    figure = Figure(figsize=(10.5 if zoomed else 6.2, 3.9), layout="constrained")
    panels = figure.subplots(1, 2 if zoomed else 1, squeeze=False)[0]
    bottom = _floor(lines)
    _draw(panels[0], lines, measure, (bottom, 1.04 * top))
    if not zoomed:
        style.label_ends(panels[0], [line.label for line in lines])
        panels[0].set_title(heading(comparison.runs))
        return figure
    edge = 1.04 * max(inner)
    panels[0].axhspan(bottom, edge, color="#e6e6e6", linewidth=0, zorder=0)
    outside = [line for line in lines if line.mean[-1] > edge]
    middle = ((bottom + edge) / 2, "enlarged at right", "#555555")
    style.label_ends(panels[0], [*(line.label for line in outside), middle])
    panels[0].set_title(": ".join(filter(None, [heading(comparison.runs), "All methods"])))
    _draw(panels[1], lines, measure, (bottom, edge))
    style.label_ends(panels[1], [line.label for line in lines if line not in outside])
    panels[1].set_title("Enlarged: methods that recover a reward")
    return figure


def _looks(comparisons: Sequence[Comparison]) -> dict[Key, Look]:
    """The look of every method and slug, in the order of tables: one colour a method, dashes for its variants."""
    every = replace(comparisons[0].runs, frame=pd.concat([comparison.runs.frame for comparison in comparisons]))
    groups = ordered_groups(every)
    palette = style.colours(method for method, _, _ in groups)
    looks, variants = {}, dict.fromkeys(palette, 0)
    for method, slug, group in groups:
        dashes = style.DASHES[variants[method] % len(style.DASHES)]
        looks[method, slug] = Look(display_name(group), palette[method], dashes)
        variants[method] += 1
    return looks


def _curves(comparison: Comparison, measure: Measure, looks: Mapping[Key, Look]) -> list[Curve]:
    lines = []
    unit = comparison.trajectory or 1
    for method, slug, group in ordered_groups(comparison.runs):
        loaded = load_curves(group, measure.metric)
        if loaded is None:
            continue
        recovers = "reward/mse" in group and bool(group["reward/mse"].notna().any())
        lines.append(Curve(looks[method, slug], recovers, loaded[0] / unit, *statistics.mean_band(loaded[1])))
    return lines


def _floor(lines: list[Curve]) -> float:
    return min(0.0, *(float(np.nanmin(np.append(line.low, line.mean))) for line in lines))


def _draw(axes: Axes, lines: list[Curve], measure: Measure, limits: tuple[float, float]) -> None:
    for line in lines:
        axes.fill_between(line.steps, line.low, line.high, color=line.look.colour, alpha=0.16, linewidth=0)
        axes.plot(line.steps, line.mean, color=line.look.colour, linestyle=line.look.dashes)
    axes.set_xlim(0, max(line.steps[-1] for line in lines))
    axes.set_ylim(*limits)
    axes.grid(axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.yaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.set_ylabel(measure.axis)


def _scores(comparison: Comparison) -> dict[Key, Array]:
    """The known final scores of every method and slug."""
    groups = ordered_groups(comparison.runs)
    known = {(m, s): group[comparison.primary.metric].dropna().to_numpy(dtype=float) for m, s, group in groups}
    return {key: scores for key, scores in known.items() if len(scores)}


def _draw_scores(axes: Axes, comparison: Comparison, looks: Mapping[Key, Look], places: Mapping[Key, int]) -> str:
    """The points of one setting; returns what a reader has to be told about the axis."""
    every = _scores(comparison)
    middles = {(row["method"], row["slug"]): interval_of(row, "iqm") for row in comparison.rows}
    for key, scores in every.items():
        place, colour, middle = places[key], looks[key].colour, middles[key]
        # The golden ratio spreads neighbours evenly, so that no random numbers are needed.
        jitter = (np.argsort(np.argsort(scores)) * 0.618034 % 1 - 0.5) * 0.5
        axes.scatter(scores, place + jitter, s=9, color=colour, alpha=0.45, linewidths=0)
        if not np.isnan(middle.low):
            axes.plot([middle.low, middle.high], [place, place], color="black", linewidth=1.6, zorder=4)
        axes.plot(middle.value, place, "o", markersize=5.5, color=colour, markeredgecolor="black", zorder=5)
    together = np.concatenate(list(every.values()))
    remark = style.spread_out(axes, together)
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    if comparison.counts_trapped and together.max() > comparison.trapped_above:
        axes.axvline(comparison.trapped_above, color="#555555", linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            f"trapped above {comparison.trapped_above:g}",
            xy=(comparison.trapped_above, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 1),
            textcoords="offset points",
            fontsize=7.5,
            color="#555555",
        )
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")
    return remark


def _letters(names: Iterable[str]) -> int:
    """The letters of the longest line."""
    return max(len(line) for name in names for line in name.split("\n"))


def _two_lines(name: str) -> str:
    """The slug of a variant below its name."""
    return name.replace(" (", "\n(")

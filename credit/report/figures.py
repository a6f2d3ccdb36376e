"""Curves over time and the spread of final scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from credit.report import statistics, style
from credit.report.comparison import Comparison, Measure, display_name, interval_of, ordered_groups
from credit.report.runs import Runs, load_curves

Array = statistics.Array


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of the curves figure: steps [L], mean and 95% interval [L] over seeds."""

    method: str
    name: str
    colour: str
    dashes: object
    recovers: bool
    steps: Array
    mean: Array
    low: Array
    high: Array


def curves_figure(runs: Runs, measure: Measure) -> Figure | None:
    """Mean and 95% interval over seeds of a metric against primitive steps (the paper's Figure 2).

    The left panel holds all methods. Where those that recover a reward lie close together at its foot, a
    second panel enlarges their range.

    Args:
        runs: finished runs.
        measure: the metric to draw.

    Returns:
        The figure, or None where no run has a curve of it.
    """
    lines = _curves(runs, measure.metric)
    if not lines:
        return None
    top = max(_ceiling(line) for line in lines)
    inner = [_ceiling(line) for line in lines if line.recovers]
    zoomed = bool(inner) and len(inner) < len(lines) and max(inner) < 0.5 * top
    figure = Figure(figsize=(10.5 if zoomed else 6.2, 3.9), layout="constrained")
    panels = figure.subplots(1, 2 if zoomed else 1, squeeze=False)[0]
    bottom = min(0.0, *(float(np.nanmin(np.append(line.low, line.mean))) for line in lines))
    _draw(panels[0], lines, measure, (bottom, 1.04 * top))
    if zoomed:
        edge = 1.04 * max(inner)
        panels[0].axhspan(bottom, edge, color="#e6e6e6", linewidth=0, zorder=0)
        outside = [line for line in lines if line.mean[-1] > edge]
        style.label_ends(panels[0], [*map(_label, outside), ((bottom + edge) / 2, "enlarged at right", "#555555")])
        panels[0].set_title("All methods")
        _draw(panels[1], lines, measure, (bottom, edge))
        style.label_ends(panels[1], [_label(line) for line in lines if line not in outside])
        panels[1].set_title("Enlarged: methods that recover a reward")
    else:
        style.label_ends(panels[0], [_label(line) for line in lines])
    figure.supxlabel("Primitive environment steps (mean over seeds and 95% interval)", fontsize=9)
    return figure


def distribution_figure(runs: Runs, comparison: Comparison) -> Figure:
    """Every seed's final score as a point, with the interquartile mean and its 95% interval.

    Args:
        runs: finished runs.
        comparison: their comparison, for the primary measure and the order of rows.
    """
    measure = comparison.primary
    groups = [entry for entry in ordered_groups(runs) if entry[2][measure.metric].notna().any()]
    palette = style.colours(method for method, _, _ in groups)
    figure = Figure(figsize=(7.2, 1.1 + 0.42 * len(groups)), layout="constrained")
    axes = figure.subplots()
    middles = {(row["method"], row["slug"]): interval_of(row, "iqm") for row in comparison.rows}
    for place, (method, slug, group) in enumerate(groups):
        scores = group[measure.metric].dropna().to_numpy(dtype=float)
        # The golden ratio spreads neighbours evenly, so that no random numbers are needed.
        jitter = (np.argsort(np.argsort(scores)) * 0.618034 % 1 - 0.5) * 0.5
        axes.scatter(scores, place + jitter, s=9, color=palette[method], alpha=0.45, linewidths=0)
        middle = middles[method, slug]
        if not np.isnan(middle.low):
            axes.plot([middle.low, middle.high], [place, place], color="black", linewidth=1.6, zorder=4)
        axes.plot(middle.value, place, "o", markersize=5.5, color=palette[method], markeredgecolor="black", zorder=5)
    every = runs.frame[measure.metric].dropna()
    remark = _spread_out(axes, every.to_numpy(dtype=float))
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    if comparison.counts_trapped and every.max() > comparison.trapped_above:
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
    axes.set_yticks(range(len(groups)), [_two_lines(display_name(group)) for _, _, group in groups])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(groups) - 0.5, -0.6)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")
    axes.set_xlabel(f"{measure.title} (points: seeds; circle and bar: interquartile mean, 95% interval{remark})")
    return figure


def _spread_out(axes: Axes, scores: Array) -> str:
    """A logarithmic axis where scores differ tenfold; where some are not positive, linear around zero.

    Returns:
        What a reader has to be told about the axis.
    """
    lower = float(np.quantile(scores, 0.25))
    if lower <= 0 or scores.max() < 10 * lower:
        return ""
    remark = ""
    if scores.min() > 0:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    else:
        linear = 10.0 ** round(np.log10(lower))
        decades = 10.0 ** np.arange(np.ceil(np.log10(scores.max() / linear)))
        limits = (min(1.3 * scores.min(), -0.1 * linear), 1.2 * scores.max())
        ticks = np.array([-2, -1, -0.5, 0, 0.5, *np.outer(decades, [1, 2, 5]).ravel()]) * linear
        axes.set_xscale("symlog", linthresh=linear, linscale=1.5)
        axes.set_xticks(ticks[(ticks >= limits[0]) & (ticks <= limits[1])])
        axes.set_xlim(*limits)
        remark = f"; linear up to {linear:g}"
    axes.xaxis.set_minor_formatter(NullFormatter())
    return remark


def _curves(runs: Runs, metric: str) -> list[Curve]:
    groups = ordered_groups(runs)
    palette = style.colours(method for method, _, _ in groups)
    lines, variants = [], dict.fromkeys(palette, 0)
    for method, _, group in groups:
        loaded = load_curves(group, metric)
        if loaded is None:
            continue
        recovers = "reward/mse" in group and bool(group["reward/mse"].notna().any())
        dashes = style.DASHES[variants[method] % len(style.DASHES)]
        band = statistics.mean_band(loaded[1])
        lines.append(Curve(method, display_name(group), palette[method], dashes, recovers, loaded[0], *band))
        variants[method] += 1
    return lines


def _ceiling(line: Curve) -> float:
    return float(np.nanmax(np.append(line.high, line.mean)))


def _draw(axes: Axes, lines: list[Curve], measure: Measure, limits: tuple[float, float]) -> None:
    for line in lines:
        axes.fill_between(line.steps, line.low, line.high, color=line.colour, alpha=0.16, linewidth=0)
        axes.plot(line.steps, line.mean, color=line.colour, linestyle=line.dashes)
    axes.set_xlim(0, max(line.steps[-1] for line in lines))
    axes.set_ylim(*limits)
    axes.grid(axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.yaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.set_ylabel(measure.axis)


def _label(line: Curve) -> tuple[float, str, str]:
    return float(line.mean[-1]), _two_lines(line.name), line.colour


def _two_lines(name: str) -> str:
    """The slug of a variant below its name."""
    return name.replace(" (", "\n(")

"""Curves over time, a panel a setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from credit.report import style
from credit.report.comparison import Comparison
from credit.report.groups import Key
from credit.report.labels import letters
from credit.report.looks import APART, LETTER, LINE, MARGIN, PLOT, RATE, Look, frame, looks, panels
from credit.report.measures import AVERAGED, AVERAGED_WORTH, SUCCESS, WORTH, Measure
from credit.report.runs import load_curves
from credit.report.text import heading
from credit.runs.intervals import Array, mean_interval

POLICIES = {SUCCESS: "Current actor", AVERAGED: "Averaged actor"}
POLICIES |= {WORTH: "Current actor", AVERAGED_WORTH: "Averaged actor"}
TRAJECTORIES = "Online trajectories after the demonstrations"
Labelled = tuple[Axes, list[tuple[float, str, str]]]  # a panel; height, name and colour of what stands beside it
MANY = 6  # lines, beyond which their intervals are fainter
ROOM = 1.6  # inches of a figure above and below its panel


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
        return float(self.mean[-1]), self.look.name, self.look.colour

    @property
    def floor(self) -> float:
        """The smallest value that is drawn, or 0."""
        return min(0.0, float(np.nanmin(np.append(self.low, self.mean))))


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
    styles = looks(comparisons)
    every = [(comparison, measure) for comparison in comparisons for measure in comparison.curves]
    drawn = [(*panel, lines) for panel in every if (lines := _curves(*panel, styles))]
    if not drawn:
        return None
    if len(every) == 1 and not every[0][1].rate:
        figure, labelled = _one_setting(*drawn[0])
    else:
        figure, axes = panels(len(drawn), *_size([lines for *_, lines in drawn]))
        limits = style.shared([RATE if measure.rate else _range(lines) for _, measure, lines in drawn])
        ends = style.shared([(0.0, max(line.steps[-1] for line in lines)) for *_, lines in drawn])
        labelled = []
        for panel, (comparison, measure, lines), limit, (_, end) in zip(axes, drawn, limits, ends, strict=True):
            _draw(panel, lines, measure, limit, end)
            setting = heading(comparison.runs) if len(comparisons) > 1 else ""
            panel.set_title(style.wrapped(": ".join(filter(None, [setting, POLICIES.get(measure, "")])), PLOT))
            labelled.append((panel, [line.label for line in lines]))
    units = ["Primitive environment steps" if part.trajectory is None else TRAJECTORIES for part in comparisons]
    frame(figure, comparisons, f"{' or '.join(dict.fromkeys(units))} (mean over seeds and 95% interval)")
    figure.draw_without_rendering()  # only then is known how high a panel is
    for panel, labels in labelled:
        style.label_ends(panel, labels, gap=LINE / (panel.get_position().height * figure.get_figheight()))
    return figure


def _one_setting(comparison: Comparison, measure: Measure, lines: list[Curve]) -> tuple[Figure, list[Labelled]]:
    """The panels of the only setting, with the names beside their lines."""
    top = max(line.ceiling for line in lines)
    inner = [line.ceiling for line in lines if line.recovers]
    zoomed = bool(inner) and len(inner) < len(lines) and max(inner) < 0.5 * top
    figure, axes = panels(1 + zoomed, *_size([lines]))
    limits, end = _range(lines), max(line.steps[-1] for line in lines)
    _draw(axes[0], lines, measure, limits, end)
    if not zoomed:
        return figure, [(axes[0], [line.label for line in lines])]
    edge = 1.04 * max(inner)
    axes[0].axhspan(limits[0], edge, color="#e6e6e6", linewidth=0, zorder=0)
    outside = [line for line in lines if line.mean[-1] > edge]
    middle = ((limits[0] + edge) / 2, "enlarged at right", "#555555")
    axes[0].set_title("All methods")
    floor = min(line.floor for line in lines)
    _draw(axes[1], lines, measure, (floor - MARGIN * (edge - floor), edge), end)
    axes[1].set_title("Enlarged: methods that recover a reward")
    inside = [line.label for line in lines if line not in outside]
    return figure, [(axes[0], [*(line.label for line in outside), middle]), (axes[1], inside)]


def _size(drawn: Sequence[list[Curve]]) -> tuple[float, float]:
    """Width and height of a panel that has room for the names beside its lines."""
    names = [line.look.name for lines in drawn for line in lines]
    high = max(sum(1 + line.look.name.count("\n") for line in lines) for lines in drawn)
    return PLOT + LETTER * letters(names), max(4.1, ROOM + LINE * high)


def _curves(comparison: Comparison, measure: Measure, styles: Mapping[Key, Look]) -> list[Curve]:
    lines = []
    unit = comparison.trajectory or 1
    for method, slug, group in comparison.groups:
        loaded = load_curves(group, measure.metric)
        if loaded is None:
            continue
        recovers = "reward/mse" in group and bool(group["reward/mse"].notna().any())
        band = mean_interval(loaded[1], measure.bounds)
        lines.append(Curve(styles[method, slug], recovers, loaded[0] / unit, *band))
    return lines


def _range(lines: list[Curve]) -> tuple[float, float]:
    """The axis of all lines, with what lies at its ends."""
    floor, top = min(line.floor for line in lines), max(line.ceiling for line in lines)
    return floor - MARGIN * (top - floor), top + 2 * MARGIN * (top - floor)


def _draw(axes: Axes, lines: list[Curve], measure: Measure, limits: tuple[float, float], end: float) -> None:
    shade = 0.16 * min(1.0, MANY / len(lines)) ** 2
    for line in lines:
        axes.fill_between(line.steps, line.low, line.high, color=line.look.colour, alpha=shade, linewidth=0)
        # half of a line at an end of a rate's axis is beyond it
        axes.plot(line.steps, line.mean, color=line.look.colour, linestyle=line.look.dashes, clip_on=not measure.rate)
        if len(line.steps) == 1:  # of which neither a line nor an area is seen
            axes.vlines(line.steps, line.low, line.high, color=line.look.colour, linewidth=1, clip_on=False)
            axes.plot(line.steps, line.mean, "o", color=line.look.colour, clip_on=False)
    axes.set_xlim(0, end)
    axes.set_ylim(*limits)
    if measure.rate:
        axes.spines["bottom"].set_position(("outward", APART))
    axes.grid(axis="y")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.yaxis.set_major_formatter(FuncFormatter(style.thousands))
    axes.set_ylabel(measure.axis)

"""The spread of final scores over seeds, a panel a setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from credit.report import style
from credit.report.columns import scores_of
from credit.report.comparison import Comparison, interval_of
from credit.report.groups import Key
from credit.report.labels import letters
from credit.report.looks import APART, LETTER, LINE, PLOT, RATE, Look, frame, looks, panels
from credit.report.text import heading
from credit.runs.intervals import Array

POINTS = "Points: seeds; circle and bar: interquartile mean, 95% interval"
GREY = "#555555"


def distribution_figure(comparisons: Sequence[Comparison]) -> Figure:
    """Every seed's final score as a point, with the interquartile mean and its 95% interval.

    Args:
        comparisons: one a setting; its primary measure is drawn. A rate has a linear axis inside [0, 1].
    """
    styles = looks(comparisons)
    scored = {key for comparison in comparisons for key in _scores(comparison)}
    places = {key: place for place, key in enumerate(key for key in styles if key in scored)}
    names = [styles[key].name for key in places]
    lines = len(names) * max(2.6, 1.6 + max(name.count("\n") for name in names))
    width = PLOT + LETTER * letters(names) / min(len(comparisons), 2)  # the names stand beside the first panel alone
    figure, axes = panels(len(comparisons), width, 1.3 + 1.05 * LINE * lines, sharey=True)
    for panel, comparison in zip(axes, comparisons, strict=True):
        remark = _draw(panel, comparison, styles, places)
        if len(comparisons) > 1:
            panel.set_title(
                style.wrapped(heading(comparison.runs), PLOT), pad=16 if comparison.counts_trapped else None
            )
        panel.set_xlabel(comparison.primary.title + (f" ({remark})" if remark else ""))
    if len({part.primary for part in comparisons}) == 1:
        style.share(axes)
    axes[0].set_yticks(range(len(places)), names)
    axes[0].set_ylim(len(places) - 0.5, -0.6)
    frame(figure, comparisons, POINTS)
    return figure


def _scores(comparison: Comparison) -> dict[Key, Array]:
    """The known final scores of every method and slug."""
    known = {
        (method, slug): scores_of(group, comparison.primary)["score"].to_numpy(dtype=float)
        for method, slug, group in comparison.groups
    }
    return {key: scores for key, scores in known.items() if len(scores)}


def _draw(axes: Axes, comparison: Comparison, styles: Mapping[Key, Look], places: Mapping[Key, int]) -> str:
    """The points of one setting; returns what a reader has to be told about the axis."""
    every = _scores(comparison)
    middles = {(row["method"], row["slug"]): interval_of(row, "iqm") for row in comparison.rows}
    for key, scores in every.items():
        place, colour, middle = places[key], styles[key].colour, middles[key]
        # The golden ratio spreads neighbours evenly, so that no random numbers are needed.
        jitter = (np.argsort(np.argsort(scores)) * 0.618034 % 1 - 0.5) * 0.5
        inside = not comparison.primary.rate  # half of a point at an end of a rate's axis is beyond it
        axes.scatter(scores, place + jitter, s=9, color=colour, alpha=0.45, linewidths=0, clip_on=inside)
        if not np.isnan(middle.low):
            axes.plot([middle.low, middle.high], [place, place], color="black", linewidth=1.6, zorder=4, clip_on=inside)
        (circle,) = axes.plot(middle.value, place, "o", markersize=5.5, color=colour, zorder=5, clip_on=inside)
        circle.set_markeredgecolor("black")
    together = np.concatenate(list(every.values()))
    if comparison.primary.rate:
        low, high = axes.get_xlim() if np.ptp(together) else RATE
        axes.set_xlim(max(low, RATE[0]), min(high, RATE[1]))
        axes.tick_params(axis="y", pad=APART + 2)
    remark = "" if comparison.primary.rate else style.spread_out(axes, together)
    axes.xaxis.set_major_formatter(FuncFormatter(style.thousands))
    if comparison.counts_trapped and together.max() > comparison.trapped_above:
        axes.axvline(comparison.trapped_above, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            f"trapped above {comparison.trapped_above:g}",
            xy=(comparison.trapped_above, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 1),
            textcoords="offset points",
            fontsize=7.5,
            color=GREY,
        )
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")
    return remark

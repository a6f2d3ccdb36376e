"""What all figures share: one colour a method, quiet axes, and how a figure is written."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from credit.runs.palette import COLOURS

# For methods from elsewhere; those that ship have their colours in the palette.
SPARE = ("#117733", "#aa4499", "#661100", "#44aa99", "#6699cc", "#806000")
PER_INCH = 13  # letters of a title
MOST = 4.0  # times that a shared axis may be longer than what a panel needs
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))
SETTINGS: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.7,
    "svg.hashsalt": "credit",
    "text.parse_math": False,  # a title with dollars is a title
}


def colours(methods: Iterable[str]) -> dict[str, str]:
    """A colour for each method: fixed for those that ship, spare ones by name for the others."""
    names = set(methods)
    others = sorted(names - COLOURS.keys())
    chosen = {name: SPARE[index % len(SPARE)] for index, name in enumerate(others)}
    return chosen | {name: COLOURS[name] for name in names & COLOURS.keys()}


def shade(colour: str, number: int) -> str:
    """A colour for what is of the same kind: itself, then darker and lighter ones."""
    target, share = [(0.0, 0.0), (0.0, 0.45), (1.0, 0.45), (0.0, 0.7)][number % 4]
    red, green, blue = (part + share * (target - part) for part in to_rgb(colour))
    return str(to_hex((red, green, blue)))


def shared(ranges: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Limits of panels: one for all, so that they can be read across, unless it would squeeze one to a fourth.

    Args:
        ranges: what each would have alone.
    """
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    squeezed = any((end - start) * MOST < high - low for start, end in ranges)
    return list(ranges) if squeezed else [(low, high)] * len(ranges)


def share(panels: Sequence[Axes]) -> None:
    """The same horizontal limits for all panels, as `shared` says, where all are linear, or all logarithmic."""
    scales = {panel.get_xscale() for panel in panels}
    if scales in ({"linear"}, {"log"}):
        scale = panels[0].xaxis.get_transform()
        ranges = [scale.transform(panel.get_xlim()) for panel in panels]
        for panel, limits in zip(panels, shared([(low, high) for low, high in ranges]), strict=True):
            panel.set_xlim(*scale.inverted().transform(limits))


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the project's style and leave Matplotlib's global settings as they were."""
    with mpl.rc_context(SETTINGS):
        yield


def thousands(axis_value: float, _position: int = 0) -> str:
    """A tick label with a thin space between thousands."""
    return f"{axis_value:,.10g}".replace(",", "\u2009").replace("-", "−")


def label_ends(axes: Axes, labels: list[tuple[float, str, str]], gap: float = 0.045) -> None:
    """Write names beside the right ends of lines, pushed apart where they would overlap.

    Args:
        axes: the panel, with its limits already set.
        labels: (height of the line's end in data units, name, colour).
        gap: height of a line of text, as a share of the panel's height.
    """
    low, high = axes.get_ylim()
    ends = sorted(((height - low) / (high - low), name, colour) for height, name, colour in labels)
    places = _spread([(origin, gap * (1 + name.count("\n"))) for origin, name, _ in ends])
    for place, (origin, name, colour) in zip(places, ends, strict=True):
        axes.annotate(
            name,
            xy=(1.0, origin),
            xytext=(1.05, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=colour,
            va="center",
            fontsize=8,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "relpos": (0, 0.5)},
        )


def spread_out(axes: Axes, scores: NDArray[np.float64]) -> str:
    """A logarithmic axis where scores differ tenfold; where some are not positive, linear around zero.

    Args:
        axes: the panel, whose horizontal axis is changed.
        scores: [n] what is drawn.

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
        remark = f"linear up to {linear:g}"
    axes.xaxis.set_major_formatter(FuncFormatter(thousands))
    axes.xaxis.set_minor_formatter(NullFormatter())
    return remark


def wrapped(words: str, inches: float) -> str:
    """A line of text as lines that are not wider."""
    return textwrap.fill(words, max(int(inches * PER_INCH), 20), break_long_words=True, break_on_hyphens=False)


def entitle(figure: Figure, words: str) -> None:
    """Write what a figure is about above it, at its left."""
    figure.suptitle(wrapped(words, figure.get_figwidth()), fontsize=9.5, x=0.01, ha="left")


def save(figure: Figure | None, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG (200 dpi) and SVG; the same figure gives the same bytes.

    Args:
        figure: what to write; None removes what an earlier report left under this name.
        folder: an existing folder.
        name: the file name without its ending.

    Returns:
        The paths that were written.
    """
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    if figure is None:
        for path in paths:
            path.unlink(missing_ok=True)
        return []
    figure.savefig(paths[0], dpi=200, facecolor="white")
    figure.savefig(paths[1], facecolor="white", metadata={"Date": None})
    return paths


def _spread(wanted: list[tuple[float, float]]) -> list[float]:
    """Places for labels that each want (place, height), sorted; what would overlap is stacked."""
    clusters = [[label] for label in wanted]
    index = 0
    while index < len(clusters) - 1:
        left, right = clusters[index], clusters[index + 1]
        if _middle(right) - _middle(left) < (_height(left) + _height(right)) / 2:
            clusters[index : index + 2] = [left + right]
            index = max(index - 1, 0)
        else:
            index += 1
    places = []
    for cluster in clusters:
        foot = _middle(cluster) - _height(cluster) / 2
        for _, height in cluster:
            places.append(foot + height / 2)
            foot += height
    return places


def _middle(cluster: list[tuple[float, float]]) -> float:
    """Where its labels want it, as far as it stays beside the panel: what leaves it makes the panel smaller."""
    half = _height(cluster) / 2
    wanted = sum(place for place, _ in cluster) / len(cluster)
    return min(max(wanted, half), 1 - half) if half < 0.5 else 0.5


def _height(cluster: list[tuple[float, float]]) -> float:
    return sum(height for _, height in cluster)

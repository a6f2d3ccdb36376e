"""Recovered rewards as tables of numbers on colours (the paper's Figure 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from credit.report import style
from credit.report.recovered import Block, Maps
from credit.report.statistics import Array

SHADES, BLUES = colormaps["viridis"], colormaps["Blues"]
SHARE = Normalize(0, 1)
Grid = np.ndarray[Any, np.dtype[np.object_]]  # of axes


def heatmaps_figure(maps: Maps) -> Figure:
    """One panel a table, those of one scale first, and last that of another: the reference's weight, or visits.

    Args:
        maps: the tables; fields that were not visited are hatched.
    """
    panels = len(maps.blocks[0].tables) + 1
    columns = 4 if panels > 6 and not maps.by_cell else 3
    rows = -(-panels // columns)
    figure = Figure(figsize=(11.2, (0.6 + 1.55 * rows) * len(maps.blocks)), layout="constrained")
    every = np.stack([table for block in maps.blocks for table in block.tables.values()])
    scales = Normalize(float(np.nanmin(every)), float(np.nanmax(every))), SHARE
    if maps.units[1] == "visits":
        scales = scales[0], Normalize(0, max(float(np.nanmax(block.last)) for block in maps.blocks))
    parts = figure.subfigures(len(maps.blocks), 1, squeeze=False)[:, 0] if len(maps.blocks) > 1 else [figure]
    for part, block in zip(parts, maps.blocks, strict=True):
        _draw_block(block, part.subplots(rows, columns, squeeze=False), maps, scales)
        if block.title:
            part.suptitle(block.title, fontsize=9, fontweight="bold", x=0.01, ha="left")
    style.entitle(figure, maps.title)
    return figure


def _draw_block(block: Block, grid: Grid, maps: Maps, scales: tuple[Normalize, Normalize]) -> None:
    *places, last = grid.ravel()
    for place, (title, table) in zip(places, block.tables.items(), strict=False):
        _draw(place, table, block.seen, maps.axes, SHADES, scales[0])
        place.set_title(title, fontweight="normal")
    for place in places[len(block.tables) :]:
        place.set_visible(False)
    _draw(last, block.last, block.seen, maps.axes, BLUES, scales[1])
    last.set_title(block.last_title, fontweight="normal")
    # It stands last in the last row, so that its bar can stand beside it.
    rest = grid[:-1] if len(grid) > 1 else grid[:, :-1]
    for panels, limits, colours, label in zip((rest, grid[-1]), scales, (SHADES, BLUES), maps.units, strict=True):
        bar = grid[0, 0].figure.colorbar(ScalarMappable(limits, colours), ax=panels, fraction=0.02, pad=0.01)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=7.5)
        bar.set_label(label, fontsize=8)


def _draw(
    place: Axes, table: Array, seen: NDArray[np.bool_], axes: tuple[str, ...], colours: Colormap, scale: Normalize
) -> None:
    place.imshow(table, cmap=colours, norm=scale, aspect="auto", origin="lower")
    for (row, column), value in np.ndenumerate(table):
        if np.isnan(value):
            continue
        shade = colours(float(scale(value)))
        bright = 0.299 * shade[0] + 0.587 * shade[1] + 0.114 * shade[2] > 0.55
        text = place.text(
            column, row, _short(value, whole=colours is BLUES and scale.vmax != 1), ha="center", va="center", fontsize=7
        )
        text.set_color("black" if bright else "white")
        if not seen[row, column]:
            corner = (column - 0.5, row - 0.5)
            place.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="////", edgecolor="#9a9a9a", linewidth=0))
            text.set_bbox({"facecolor": shade, "edgecolor": "none", "pad": 1.0})
    place.set_xticks(range(table.shape[1]))
    place.set_yticks(range(table.shape[0]) if len(axes) > 1 else [])
    place.tick_params(length=0, labelsize=7.5)
    place.spines[:].set_visible(False)
    place.set_xlabel(axes[0], fontsize=8, labelpad=2)
    place.set_ylabel(axes[1] if len(axes) > 1 else "", fontsize=8, labelpad=4)


def _short(value: float, whole: bool) -> str:
    """Two decimals without the leading zero, as in −.05; a whole number of what is counted."""
    if whole:
        return f"{value:.0f}" if value < 9_999.5 else f"{value / 1000:.0f}k"
    digits = f"{abs(value):.2f}".removeprefix("0")
    return digits if value > -0.005 else "−" + digits

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
    """One panel a table: truth, every reward model, the mixture, and last the reference's weight.

    Args:
        maps: the tables; fields that were not visited are hatched.
    """
    panels = len(maps.blocks[0].rewards) + 1
    columns = 4 if panels > 6 and not maps.by_cell else 3
    rows = -(-panels // columns)
    figure = Figure(figsize=(11.2, (0.6 + 1.55 * rows) * len(maps.blocks)), layout="constrained")
    every = np.stack([table for block in maps.blocks for table in block.rewards.values()])
    scale = Normalize(float(np.nanmin(every)), float(np.nanmax(every)))
    parts = figure.subfigures(len(maps.blocks), 1, squeeze=False)[:, 0] if len(maps.blocks) > 1 else [figure]
    for part, block in zip(parts, maps.blocks, strict=True):
        _draw_block(block, part.subplots(rows, columns, squeeze=False), maps.axes, scale)
        if block.title:
            part.suptitle(block.title, fontsize=9, fontweight="bold", x=0.01, ha="left")
    style.entitle(figure, maps.title)
    return figure


def _draw_block(block: Block, grid: Grid, axes: tuple[str, ...], scale: Normalize) -> None:
    *places, last = grid.ravel()
    for place, (title, table) in zip(places, block.rewards.items(), strict=False):
        _draw(place, table, block.seen, axes, SHADES, scale)
        place.set_title(title, fontweight="normal")
    for place in places[len(block.rewards) :]:
        place.set_visible(False)
    _draw(last, block.weight, block.seen, axes, BLUES, SHARE)
    last.set_title(block.weight_title, fontweight="normal")
    # The weight stands last in the last row, so that its bar can stand beside it.
    for panels, limits, colours, label in ((grid[:-1], scale, SHADES, "reward"), (grid[-1], SHARE, BLUES, "weight")):
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
        text = place.text(column, row, _short(value), ha="center", va="center", fontsize=7)
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


def _short(value: float) -> str:
    """Two decimals without the leading zero, as in −.05."""
    digits = f"{abs(value):.2f}".removeprefix("0")
    return digits if value > -0.005 else "−" + digits

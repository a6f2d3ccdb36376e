"""Figure 1, and what each method drove: walls in grey, one thin line a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from credit.envs.pointmaze.maze import Cell, Maze
from credit.envs.pointmaze.task import RADIUS
from credit.report import style
from credit.report.comparison import Comparison
from credit.report.pointmaze.tracks import Journal, Tracks, counted, has_tracks, load_tracks

KINDS = {"success": "#009e73", "partial": "#e69f00", "failure": "#aa4499", "unknown": "#6699cc"}
REACHED, MISSED = "#009e73", "#d55e00"
TIME = colormaps["viridis"]
WALL = "#b9b9b9"
SIGNS = (("o", 6, "start"), ("*", 11, "goal"))
LEGEND_WIDTH = 1.5  # inches beside a maze


def draw_maze(axes: Axes, maze: Maze, start: Cell, goal: Cell, *, labelled: bool = True, size: float = 9.0) -> None:
    """Walls, start and goal, to scale.

    Args:
        axes: where. maze, start, goal: what. labelled: whether the axes have numbers.
        size: of the marks of start and goal, in points.
    """
    rows, columns = maze.grid.shape
    corners = [maze.xy(cell) for cell in maze.wall_cells]
    axes.add_collection(
        PatchCollection([Rectangle((x - 0.5, y - 0.5), 1, 1) for x, y in corners], color=WALL, linewidth=0.3, zorder=1)
    )
    axes.add_patch(Circle(maze.xy(goal), RADIUS, fill=False, edgecolor="black", linewidth=0.8, zorder=4))
    for cell, mark, width in ((start, "o", size), (goal, "*", 1.5 * size)):
        (point,) = axes.plot(*maze.xy(cell), mark, color="white", markersize=width, zorder=5)
        point.set(markeredgecolor="black", markeredgewidth=0.9)
    axes.set_xlim(-columns / 2, columns / 2)
    axes.set_ylim(-rows / 2, rows / 2)
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    axes.grid(visible=False)
    if labelled:
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    else:
        axes.set_xticks([])
        axes.set_yticks([])


def demonstrations_figure(comparisons: Sequence[Comparison]) -> Figure | None:
    """The maze with start and goal, and the demonstrations by kind (the paper's Figure 1); a panel a maze.

    Args:
        comparisons: of each maze the first run is drawn.

    Returns:
        The figure, or None where no run kept its trajectories.
    """
    journals: dict[object, Journal] = {}
    for comparison in comparisons:
        for _, _, group in comparison.groups:
            folder = next(filter(has_tracks, group["folder"]), None)
            if folder is not None:
                journal = load_tracks(folder)
                journals.setdefault(journal.task, journal)
    if not journals:
        return None
    sizes = [_size(journal) for journal in journals.values()]
    size = (sum(width for width, _ in sizes) + LEGEND_WIDTH * len(sizes), max(height for _, height in sizes))
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, len(sizes), squeeze=False)[0]
    for axes, journal in zip(panels, journals.values(), strict=True):
        draw_maze(axes, *journal.task)
        tracks = journal.demonstrations
        kinds = tracks.kinds or ("unknown",) * len(tracks)
        # successes last: the others start on the same way and would cover them
        order = sorted(range(len(tracks)), key=lambda i: kinds[i] == "success")
        ordered = Tracks(tuple(tracks.places[i] for i in order), tracks.success[order])
        _draw_tracks(axes, ordered, [KINDS.get(kinds[i], KINDS["unknown"]) for i in order])
        found = {f"{kind} ({kinds.count(kind)})": colour for kind, colour in KINDS.items() if kind in kinds}
        _legend(axes, found)
        axes.set_title(f"{len(tracks)} demonstrations" if len(tracks) else "no demonstrations")
    style.entitle(figure, comparisons[0].runs.experiment)
    return figure


def tracks_figure(title: str, journal: Journal) -> Figure:
    """What one run drove: online by time and by success, and the last evaluation by success.

    Args:
        title: whose. journal: the run.
    """
    width, height = _size(journal)
    figure = Figure(figsize=(3 * width, height + 0.9), layout="constrained")
    panels, below = figure.subplots(2, 3, height_ratios=[1, 0.04])
    for axes in panels:
        draw_maze(axes, *journal.task)
    online, last = journal.online, journal.evaluation
    scale = Normalize(1, max(len(online), 2))
    _draw_tracks(panels[0], online, [to_hex(TIME(scale(1 + i))) for i in range(len(online))])
    panels[0].set_title("Online, by time")
    bar = figure.colorbar(ScalarMappable(scale, TIME), cax=below[0], orientation="horizontal")
    bar.set_label("online trajectory", fontsize=8)
    bar.ax.tick_params(labelsize=7.5)
    bar.outline.set_visible(False)
    for axes, foot, tracks, what in zip(panels[1:], below[1:], (online, last), ("Online", "Final policy"), strict=True):
        _draw_tracks(axes, tracks, [REACHED if reached else MISSED for reached in tracks.success])
        axes.set_title(f"{what}: {counted(tracks.success)} reach the goal")
        words = {REACHED: "reaches the goal", MISSED: "does not"}
        marks = [Line2D([], [], color=colour, label=word) for colour, word in words.items()]
        foot.legend(handles=marks, loc="upper center", ncols=2, frameon=False, fontsize=8)
        foot.set_axis_off()
    style.entitle(figure, title)
    return figure


def _size(journal: Journal) -> tuple[float, float]:
    """Width and height (inches) of a panel with its numbers."""
    rows, columns = journal.maze.grid.shape
    width = min(4.0, 3.4 * columns / rows)
    return width + 0.6, width * rows / columns + 0.7


def _draw_tracks(axes: Axes, tracks: Tracks, colours: Sequence[str]) -> None:
    thin = min(1.0, max(0.35, 12 / max(len(tracks), 1)))
    lines = LineCollection(list(tracks.places), colors=list(colours), linewidths=1.0, alpha=0.35 + 0.4 * thin, zorder=2)
    axes.add_collection(lines, autolim=False)
    ends = np.array([place[-1] for place in tracks.places if len(place)]).reshape(-1, 2)
    shown = [colour for colour, place in zip(colours, tracks.places, strict=True) if len(place)]
    axes.scatter(ends[:, 0], ends[:, 1], s=9, c=shown, edgecolors="white", linewidths=0.3, zorder=3)


def _legend(axes: Axes, lines: Mapping[str, str]) -> None:
    marks = [Line2D([], [], marker=mark, markersize=size, label=name) for mark, size, name in SIGNS]
    for sign in marks:
        sign.set(linestyle="", markerfacecolor="white", markeredgecolor="black")
    marks += [Line2D([], [], color=colour, marker=".", label=name) for name, colour in lines.items()]
    axes.legend(handles=marks, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8.5)

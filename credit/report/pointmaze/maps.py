"""What a method believes about the reward, place by place: every model, the mixture, weights and the best model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from credit.envs.pointmaze.maze import Maze
from credit.report import style
from credit.report.pointmaze.pictures import draw_maze
from credit.report.pointmaze.tracks import Journal, has_tracks, load_tracks
from credit.report.reading import arrays
from credit.report.statistics import Array

MODELS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#999933", "#332288")
SHADES, BLUES = colormaps["viridis"], colormaps["Blues"]
OUTLIERS = 0.01  # share of values at each end that does not stretch a colour scale
SIDE = 1.25  # inches of a map


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Means over seeds at some refits; values are [refit, point], one point a place.

    Attributes:
        seeds: how many.
        journal: the maze. states: the points, x and y (m) [N, 2].
        trajectories: online trajectories before each refit.
        rewards: model → learned reward of a step towards the goal; the mixture last, where there are several.
        weights: model → weight in the mixture; empty where there is one model.
        best: the model that is locally best in most seeds, as its place in `weights`; None where there is one.
    """

    seeds: int
    journal: Journal
    states: Array
    trajectories: tuple[int, ...]
    rewards: Mapping[str, Array]
    weights: Mapping[str, Array]
    best: NDArray[np.int64] | None


def load_beliefs(runs: pd.DataFrame) -> Beliefs | None:
    """The first, a middle and the last refit, averaged over runs.

    Args:
        runs: rows of `Runs.frame` of one method and slug.

    Returns:
        The beliefs, or None where no run has both a maze and a recovery over it.
    """
    wanted = ("models", "rounds", "best", "grid/states")
    found, folders = [], []
    for folder, data in over_mazes(runs):
        found.append({key: data[key] for key in data if key in wanted or key.startswith(("reward/", "weight/"))})
        folders.append(folder)
    if not found:
        return None
    journal = load_tracks(folders[0])
    models = [str(model) for model in found[0]["models"]]
    rounds, places = chosen_refits(found)

    def stack(key: str) -> NDArray[Any]:
        return np.stack([np.asarray(arrays[key])[places] for arrays in found])

    several = len(models) > 1
    rewards = {model: stack(f"reward/{model}").mean(0) for model in [*models, *(["mixed"] if several else [])]}
    weights = {model: stack(f"weight/{model}").mean(0) for model in models} if several else {}
    best = None
    if several:
        chosen = stack("best")
        best = np.argmax([(chosen == index).mean(0) for index in range(len(models))], axis=0)
    states = np.asarray(found[0]["grid/states"], dtype=float)[:, :2]
    return Beliefs(len(found), journal, states, tuple(int(rounds[place]) for place in places), rewards, weights, best)


def over_mazes(runs: pd.DataFrame) -> Iterator[tuple[Any, Any]]:
    """Folder and open arrays of every run that has both a maze and a recovery over it; rows of `Runs.frame`."""
    for folder in runs["folder"]:
        path = Path(folder) / "recovery.npz"
        if has_tracks(folder) and path.exists():
            with arrays(folder, path.name) as data:
                if "grid/states" in data:
                    yield folder, data


def chosen_refits(found: Sequence[Mapping[str, Any]]) -> tuple[NDArray[np.int64], list[int]]:
    """The trajectories before each refit that all runs had, and the places of the first, a middle and the last one."""
    rounds = min((arrays["rounds"] for arrays in found), key=len)  # a run that was stopped early has fewer
    return rounds, sorted({0, len(rounds) // 2, len(rounds) - 1})


def raster(maze: Maze, states: Array, values: NDArray[Any]) -> Array:
    """Values at points as an image whose first row is the top; NaN in walls.

    Args:
        maze: with an equal number k² of points in every free cell.
        states: x, y (m) [N, 2].
        values: [N].

    Returns:
        [rows·k, columns·k].
    """
    fine = round((len(states) / len(maze.free)) ** 0.5)
    rows, columns = maze.grid.shape
    image = np.full((rows * fine, columns * fine), np.nan)
    down = np.floor((rows / 2 - states[:, 1]) * fine).astype(int)
    across = np.floor((states[:, 0] + columns / 2) * fine).astype(int)
    image[down, across] = values
    return image


def beliefs_figure(title: str, beliefs: Beliefs) -> Figure:
    """Rows: models, and last the mixture beside the best model. Columns: refits, rewards left and weights right.

    Args:
        title: whose. beliefs: what to draw; each row of rewards has its own scale.
    """
    halves = 2 if beliefs.weights else 1
    figure, parts, grids = empty(beliefs.journal.maze, len(beliefs.rewards), len(beliefs.trajectories), halves)
    for row, (model, values) in zip(grids[0], beliefs.rewards.items(), strict=True):
        low, high_end = np.nanquantile(values, [OUTLIERS, 1 - OUTLIERS])
        scale = Normalize(float(low), float(high_end))
        name = "mixture" if model == "mixed" else model
        draw_row(row, beliefs.journal, beliefs.states, values, SHADES, scale, name)
        bar = parts[0].colorbar(ScalarMappable(scale, SHADES), ax=list(row), extend="both", fraction=0.04, pad=0.02)
        quiet(bar)
    parts[0].suptitle("Learned reward of a step towards the goal", fontsize=9, fontweight="bold")
    if beliefs.best is not None:
        _draw_weights(parts[1], grids[1], beliefs, beliefs.best)
    for part in parts:
        say_when(part, beliefs.trajectories)
    style.entitle(figure, title)
    return figure


def empty(maze: Maze, rows: int, columns: int, halves: int) -> tuple[Figure, list[Any], list[Any]]:
    """A figure for maps of a maze, its halves side by side, and the axes of each [rows, columns]."""
    shape = maze.grid.shape
    wide, high = SIDE * shape[1] / max(shape) + 0.1, SIDE * shape[0] / max(shape) + 0.12
    size = (halves * (columns * wide + 1.0) + 0.3, rows * high + 0.95)
    figure = Figure(figsize=(max(size[0], 6.0), size[1]), layout="constrained")
    parts = list(figure.subfigures(1, halves, squeeze=False)[0])
    return figure, parts, [part.subplots(rows, columns, squeeze=False) for part in parts]


def say_when(part: Any, trajectories: Sequence[int]) -> None:
    """Write above each column of a half after how many online trajectories that was."""
    for axes, count in zip(part.axes[: len(trajectories)], trajectories, strict=True):
        when = f"after {count} trajectories" if count else "demonstrations only"
        axes.set_title(when, fontsize=8, fontweight="normal", loc="center")


def _draw_weights(part: Any, grid: Any, beliefs: Beliefs, best: NDArray[np.int64]) -> None:
    scale = Normalize(0, 1)
    for row, (model, values) in zip(grid, beliefs.weights.items(), strict=False):
        draw_row(row, beliefs.journal, beliefs.states, values, BLUES, scale, model)
        quiet(part.colorbar(ScalarMappable(scale, BLUES), ax=list(row), fraction=0.04, pad=0.02))
    names = list(beliefs.weights)
    shades = [MODELS[index % len(MODELS)] for index in range(len(names))]
    colours, limits = ListedColormap(shades), Normalize(-0.5, len(names) - 0.5)
    draw_row(grid[-1], beliefs.journal, beliefs.states, best, colours, limits, "best model")
    bar = part.colorbar(ScalarMappable(limits, colours), ax=list(grid[-1]), fraction=0.04, pad=0.02)
    quiet(bar)
    bar.set_ticks(range(len(names)), labels=names)
    part.suptitle("Weight in the mixture", fontsize=9, fontweight="bold")


def draw_row(
    row: Any, journal: Journal, states: Array, values: NDArray[Any], colours: Any, scale: Normalize, name: str
) -> None:
    """Draw a row of maps, one a refit; its name stands at the left.

    Args:
        row: the axes, one a refit. journal: the maze. states: x, y (m) [N, 2]. values: [refit, N].
        colours: a colour map. scale: of the values. name: of the row.
    """
    maze, start, goal = journal.task
    height, width = maze.grid.shape
    for axes, value in zip(row, values, strict=True):
        image = raster(maze, states, value)
        extent = (-width / 2, width / 2, -height / 2, height / 2)
        axes.imshow(image, cmap=colours, norm=scale, extent=extent, origin="upper", interpolation="nearest")
        draw_maze(axes, maze, start, goal, labelled=False, size=4.0)
    row[0].set_ylabel(name, fontsize=8.5)


def quiet(bar: Any) -> None:
    """A colour bar without a frame, and with few ticks."""
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7)
    bar.locator = MaxNLocator(4)
    bar.update_ticks()

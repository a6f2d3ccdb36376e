"""How far a method's beliefs can be trusted, place by place: the MSE proxies, the disagreement, and visits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from credit.report import style
from credit.report.pointmaze.maps import (
    BLUES,
    OUTLIERS,
    SHADES,
    chosen_refits,
    draw_row,
    empty,
    over_mazes,
    quiet,
    say_when,
)
from credit.report.pointmaze.tracks import Journal, load_tracks
from credit.report.statistics import Array


@dataclass(frozen=True, eq=False)
class Doubts:
    """Means over seeds at some refits; values are [refit, point], one point a place.

    Attributes:
        seeds: how many.
        journal: the maze. states: the points, x and y (m) [N, 2].
        trajectories: online trajectories before each refit.
        proxies: model → √m (10), (11), in units of the reward.
        gaps: surrogate → √Δ̂² to the reference (9); empty where there is one model. reference: its name.
        visits: how many steps were spent in the square around a point until then, demonstrations included.
    """

    seeds: int
    journal: Journal
    states: Array
    trajectories: tuple[int, ...]
    proxies: Mapping[str, Array]
    gaps: Mapping[str, Array]
    reference: str
    visits: Array


def load_doubts(runs: pd.DataFrame) -> Doubts | None:
    """The first, a middle and the last refit, averaged over runs.

    Args:
        runs: rows of `Runs.frame` of one method and slug.

    Returns:
        The doubts, or None where no run has both a maze and MSE proxies over it.
    """
    found: list[dict[str, Any]] = []
    journals: list[Journal] = []
    for folder, data in over_mazes(runs):
        models = [str(model) for model in data["models"]]
        keys = [*(f"mse/{model}" for model in models), *(f"disagreement/{model}" for model in models[1:])]
        if not {*keys} <= {*data}:
            continue
        found.append({key: data[key] for key in ("models", "rounds", "grid/states", *keys)})
        journals.append(load_tracks(folder))
    if not found:
        return None
    reference, *surrogates = (str(model) for model in found[0]["models"])
    rounds, places = chosen_refits(found)
    trajectories = tuple(int(rounds[place]) for place in places)

    def root(key: str) -> Array:
        squares = np.stack([np.asarray(each[key], dtype=float)[places] for each in found])
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)).mean(0))

    proxies = {model: root(f"mse/{model}") for model in (reference, *surrogates)}
    gaps = {model: root(f"disagreement/{model}") for model in surrogates}
    states = np.asarray(found[0]["grid/states"], dtype=float)[:, :2]
    visits = np.mean([[visited(each, states, count) for count in trajectories] for each in journals], axis=0)
    return Doubts(len(found), journals[0], states, trajectories, proxies, gaps, reference, visits)


def visited(journal: Journal, states: Array, trajectories: int) -> Array:
    """Steps in the square around each point, of the demonstrations and the first online trajectories [N].

    Args:
        journal: a run. states: the points, x and y (m) [N, 2]. trajectories: how many.
    """
    driven = [*journal.demonstrations.places, *journal.online.places[:trajectories]]
    counts = np.zeros(len(states))
    if not driven:
        return counts
    rows, columns, fine = _pixels(journal, states, states)
    number = np.full((int(fine * journal.maze.grid.shape[0]), int(fine * journal.maze.grid.shape[1])), -1)
    number[rows, columns] = np.arange(len(states))
    down, across, _ = _pixels(journal, states, np.concatenate(driven))
    inside = (down >= 0) & (down < number.shape[0]) & (across >= 0) & (across < number.shape[1])
    hit = number[down[inside], across[inside]]
    np.add.at(counts, hit[hit >= 0], 1)
    return counts


def _pixels(journal: Journal, points: Array, places: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """The row and the column of places [K, 2] in the raster of points, and its squares a metre."""
    fine = round((len(points) / len(journal.maze.free)) ** 0.5)
    height, width = journal.maze.grid.shape
    down = np.floor((height / 2 - places[:, 1]) * fine).astype(np.int64)
    return down, np.floor((places[:, 0] + width / 2) * fine).astype(np.int64), fine


def doubts_figure(title: str, doubts: Doubts) -> Figure:
    """Left a row a model: √m. Right a row a surrogate: its distance to the reference; last the visits.

    Args:
        title: whose. doubts: what to draw; all but the visits have one scale.
    """
    figure, parts, grids = empty(doubts.journal.maze, len(doubts.proxies), len(doubts.trajectories), halves=2)
    every = np.stack([*doubts.proxies.values(), *doubts.gaps.values()])
    scale = Normalize(0.0, float(np.nanquantile(every, 1 - OUTLIERS)))
    rows = [(grids[0], doubts.proxies, "{}"), (grids[1], doubts.gaps, f"|{doubts.reference} − {{}}|")]
    for part, (grid, tables, name) in zip(parts, rows, strict=True):
        for row, (model, values) in zip(grid, tables.items(), strict=False):
            draw_row(row, doubts.journal, doubts.states, values, SHADES, scale, name.format(model))
            bar = part.colorbar(ScalarMappable(scale, SHADES), ax=list(row), extend="max", fraction=0.04, pad=0.02)
            quiet(bar)
    counts = SymLogNorm(1.0, vmin=0.0, vmax=max(float(doubts.visits.max()), 1.0))
    draw_row(grids[1][-1], doubts.journal, doubts.states, doubts.visits, BLUES, counts, "visits")
    bar = parts[1].colorbar(ScalarMappable(counts, BLUES), ax=list(grids[1][-1]), fraction=0.04, pad=0.02)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(style.thousands))
    parts[0].suptitle("√MSE proxy, in units of the reward", fontsize=9, fontweight="bold")
    parts[1].suptitle("Disagreement and visits" if doubts.gaps else "Visits", fontsize=9, fontweight="bold")
    for part in parts:
        say_when(part, doubts.trajectories)
    style.entitle(figure, title)
    return figure

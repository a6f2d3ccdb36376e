"""The maze of a run and the trajectories through it, as `trajectories.npz` has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.envs.pointmaze.maze import Cell, Maze
from credit.report import settings
from credit.report.comparison import Comparison, display_name
from credit.report.pointmaze.recognise import FILE
from credit.report.reading import arrays

LONGEST = 120  # letters of a variant in the name of a file
PARTS = ("demonstrations", "online", "evaluation")


@dataclass(frozen=True, eq=False)
class Tracks:
    """K trajectories: their places (m) [L_i, 2], whether each is a success [K], and how it was made [K], if known."""

    places: tuple[NDArray[np.float32], ...]
    success: NDArray[np.bool_]
    kinds: tuple[str, ...] = ()

    def __len__(self) -> int:
        """K."""
        return len(self.places)


@dataclass(frozen=True, eq=False)
class Journal:
    """One run: its maze, where it starts, where it is to go, and its trajectories by part."""

    maze: Maze
    start: Cell
    goal: Cell
    demonstrations: Tracks
    online: Tracks
    evaluation: Tracks

    @property
    def task(self) -> tuple[Maze, Cell, Cell]:
        """What makes two runs' mazes the same."""
        return self.maze, self.start, self.goal


def has_tracks(folder: str) -> bool:
    """Whether a run kept its trajectories."""
    return (Path(folder) / FILE).exists()


def load_tracks(folder: str) -> Journal:
    """Read `trajectories.npz` of a run.

    Raises:
        UserError: it is damaged.
    """
    with arrays(folder, FILE) as data:
        walls = tuple(tuple(row) for row in data["maze/walls"].astype(bool).tolist())
        start, goal = ((int(data[key][0]), int(data[key][1])) for key in ("maze/start", "maze/goal"))
        parts = {}
        for part in PARTS:
            ends = np.cumsum(data[f"{part}/lengths"])
            places = np.split(data[f"{part}/states"][:, :2], ends)[: len(ends)]
            kinds = tuple(data[f"{part}/kinds"].tolist()) if f"{part}/kinds" in data else ()
            parts[part] = Tracks(tuple(places), data[f"{part}/labels"] > 0.5, kinds)
    return Journal(Maze("of the run", walls), start, goal, **parts)


def typical(group: pd.DataFrame, comparison: Comparison, seed: int | None) -> pd.Series | None:
    """The run that stands for a method: the one asked for, or that of the median success (the lower of two).

    Args:
        group: the runs of a method and slug. comparison: knows what success is. seed: the one asked for.

    Returns:
        Its row, or None where no run kept its trajectories.

    Raises:
        UserError: the seed is not among the runs.
    """
    if seed is not None and seed not in set(group["seed"]):
        raise UserError(
            f"diagnostics_seed={seed} is not among the finished seeds of {display_name(group)}: "
            f"{group['seed'].min()} to {group['seed'].max()}."
        )
    known = group[[has_tracks(folder) for folder in group["folder"]]]
    if seed is not None:
        known = known[known["seed"] == seed]
    if known.empty:
        return None
    ordered = known.sort_values([comparison.primary.metric, "seed"])
    scored = ordered[comparison.primary.metric].notna().sum() or len(ordered)
    return ordered.iloc[(scored - 1) // 2]


def file_name(kind: str, setting: str, method: str, slug: str) -> str:
    """What a picture of a method is called."""
    short = slug if len(slug) <= LONGEST else settings.file_name(slug)  # files have shorter names than variants
    return "_".join(filter(None, [kind, setting, method, "" if slug == "default" else short]))


def counted(success: Sequence[bool] | NDArray[np.bool_]) -> str:
    """How many succeeded, such as `12 of 20`."""
    return f"{int(np.sum(success))} of {len(success)}"

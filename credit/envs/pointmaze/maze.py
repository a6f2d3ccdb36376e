"""Maps of free and wall cells: the official ones, read from Gymnasium-Robotics, or a user's own."""

from __future__ import annotations

import importlib.util
import math
import runpy
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError, nearest

Cell = tuple[int, int]
Row = str | int | Sequence[str | int]  # 101, "101" and [1, 0, 1] are one

OFFICIAL = {"UMaze": "U_MAZE", "Open": "OPEN", "Medium": "MEDIUM_MAZE", "Large": "LARGE_MAZE"}
WALL, FREE = "1#", "0. rgc"  # r, g, c are free: start and goal are keys of their own
MOVES = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True)
class Maze:
    """A map of cells of 1 m, centred on the origin; a cell is (row, column), row 0 is the top (largest y).

    Args:
        name: what messages call it.
        walls: one row after the other, True where there is a wall; the border is wall.

    Example:
        >>> Maze.of("Medium").xy((1, 1))
        (-2.5, 2.5)
    """

    name: str
    walls: tuple[tuple[bool, ...], ...]

    def __post_init__(self) -> None:
        widths = sorted({len(row) for row in self.walls})
        if len(self.walls) < 3 or len(widths) != 1 or widths[0] < 3:
            raise UserError(
                f"maze {self.name} has {len(self.walls)} rows of {widths} cells; a map is a rectangle, 3 x 3 or more"
            )
        grid = self.grid
        if not (grid[[0, -1]].all() and grid[:, [0, -1]].all()):
            holes = [(r, c) for r, c in self.free if r in (0, grid.shape[0] - 1) or c in (0, grid.shape[1] - 1)]
            raise UserError(f"maze {self.name}: the ball could leave it at {_listed(holes)}; the border must be wall")
        if not self.free:
            raise UserError(f"maze {self.name}: every cell is a wall; at least one must be free (0)")

    @classmethod
    def of(cls, maze: str | Sequence[Row]) -> Maze:
        """An official map by its name, or a map given row by row.

        Args:
            maze: UMaze, Open, Medium or Large, or rows of cells, each a string, a list, or a number as YAML reads a row
                without quotes: 1 or # is a wall; 0, a dot or a blank is free, and so are r, g and c.

        Raises:
            UserError: unknown name or cell, rows of different length, an open border, no free cell.
        """
        if isinstance(maze, str):
            names = {name.lower(): name for name in OFFICIAL}
            if maze.lower() not in names:
                raise UserError(
                    f"maze={maze!r} is unknown: {nearest(maze, OFFICIAL)}; a map of your own is a list of rows"
                )
            name = names[maze.lower()]
            return cls(name, _parsed(name, _official()[OFFICIAL[name]]))
        return cls("of your own", _parsed("of your own", maze))

    @cached_property
    def grid(self) -> NDArray[np.bool_]:
        """Walls [rows, columns]."""
        return np.array(self.walls)

    @cached_property
    def free(self) -> tuple[Cell, ...]:
        """The free cells, row by row; a cell's place here is its number in the box-region model."""
        return tuple((int(r), int(c)) for r, c in np.argwhere(~self.grid))

    @cached_property
    def wall_cells(self) -> tuple[Cell, ...]:
        """The wall cells, row by row."""
        return tuple((int(r), int(c)) for r, c in np.argwhere(self.grid))

    def xy(self, cell: Cell) -> tuple[float, float]:
        """The centre of a cell (m)."""
        rows, columns = self.grid.shape
        return cell[1] + 0.5 - columns / 2, rows / 2 - (cell[0] + 0.5)

    def cell(self, x: float, y: float) -> Cell:
        """The cell that holds a position (m); it may lie outside the map."""
        rows, columns = self.grid.shape
        return math.floor(rows / 2 - y), math.floor(x + columns / 2)

    def is_free(self, cell: Cell) -> bool:
        """Whether a cell lies in the map and is no wall."""
        rows, columns = self.grid.shape
        return 0 <= cell[0] < rows and 0 <= cell[1] < columns and not self.walls[cell[0]][cell[1]]

    def require_free(self, key: str, cell: Cell) -> None:
        """Refuse a cell that is a wall or outside.

        Raises:
            UserError: names the key, the cell and the free cells.
        """
        if not self.is_free(cell):
            rows, columns = self.grid.shape
            inside = 0 <= cell[0] < rows and 0 <= cell[1] < columns
            what = "is a wall" if inside else f"is outside the {rows} x {columns} cells"
            raise UserError(f"{key}={cell} {what} of maze {self.name}; free cells are {_listed(self.free)}")

    def path(self, start: Cell, goal: Cell) -> tuple[Cell, ...]:
        """A shortest path over the sides of cells, both ends included; among equals the one that first goes right.

        Raises:
            UserError: an end in a wall, or no path: then it says what can be reached.
        """
        self.require_free("start", start)
        self.require_free("goal", goal)
        before = self._tree(start)
        if goal not in before:
            raise UserError(
                f"maze {self.name} has no path from start {start} to goal {goal}: "
                f"only {_listed(sorted(before))} can be reached; open a wall or move the goal"
            )
        path = [goal]
        while path[-1] != start:
            path.append(before[path[-1]])
        return tuple(reversed(path))

    def ahead(self, goal: Cell) -> dict[Cell, Cell]:
        """Every cell from which a goal can be reached, row by row, and the next one on `path` from there to it."""
        self.require_free("goal", goal)
        left = {goal: -1}  # moves to it; that of the goal itself comes first, from which it is 0
        for cell, before in self._tree(goal).items():  # nearer ones come before others
            left[cell] = left[before] + 1
        found = {goal: goal}
        for cell in left.keys() - {goal}:
            around = ((cell[0] + down, cell[1] + right) for down, right in MOVES)
            found[cell] = next(there for there in around if left.get(there) == left[cell] - 1)
        return {cell: found[cell] for cell in self.free if cell in found}

    def _tree(self, start: Cell) -> dict[Cell, Cell]:
        """Every cell that can be reached, and the one before it on a shortest path."""
        before: dict[Cell, Cell] = {start: start}
        queue = deque([start])
        while queue:
            here = queue.popleft()
            for down, right in MOVES:
                there = (here[0] + down, here[1] + right)
                if there not in before and self.is_free(there):
                    before[there] = here
                    queue.append(there)
        return before


def robotics(file: str) -> Path:
    """A file of Gymnasium-Robotics, whose import would take time, register hundreds of environments and print.

    Raises:
        UserError: the package is not installed.
    """
    spec = importlib.util.find_spec("gymnasium_robotics")
    if spec is None or spec.origin is None:
        raise UserError("PointMaze needs two packages: pip install gymnasium-robotics mujoco")
    return Path(spec.origin).parent / file


@cache
def _official() -> dict[str, Any]:
    return runpy.run_path(str(robotics("envs/maze/maps.py")))


def _parsed(name: str, given: Sequence[Row]) -> tuple[tuple[bool, ...], ...]:
    rows = [str(row) if isinstance(row, int) else row for row in given]
    for r, row in enumerate(rows):
        for c, cell in enumerate(row):
            if str(cell) not in tuple(WALL + FREE):
                raise UserError(f"maze {name}: cell ({r}, {c}) is {cell!r}; allowed are 1 or # (wall), 0 or . (free)")
    return tuple(tuple(str(cell) in WALL for cell in row) for row in rows)


def _listed(cells: Sequence[Cell]) -> str:
    by_row: dict[int, list[str]] = {}
    for r, c in cells:
        by_row.setdefault(r, []).append(str(c))
    return ", ".join(f"row {r}: {' '.join(columns)}" for r, columns in by_row.items())

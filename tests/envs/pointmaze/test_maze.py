"""The maps, their coordinates and paths."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from gymnasium_robotics.envs.maze import maps
from gymnasium_robotics.envs.maze.maze_v4 import Maze as Official

from credit.core.errors import UserError
from credit.envs.pointmaze.maze import OFFICIAL, Cell, Maze

FREE = {1: [1, 2, 5, 6], 2: [1, 2, 4, 5, 6], 3: [2, 3, 4], 4: [1, 2, 4, 5, 6], 5: [1, 3, 4, 6], 6: [1, 2, 3, 5, 6]}


def test_the_free_cells_of_medium() -> None:
    maze = Maze.of("Medium")
    assert maze.free == tuple((row, column) for row, columns in FREE.items() for column in columns)
    assert len(maze.free) == 26
    assert len(maze.wall_cells) == 64 - 26


@pytest.mark.parametrize("name", OFFICIAL)
def test_coordinates_are_the_official_ones(name: str) -> None:
    maze = Maze.of(name)
    official = Official(getattr(maps, OFFICIAL[name]), 1.0, 0.4)
    generator = np.random.default_rng(0)
    rows, columns = maze.grid.shape
    for row, column in np.ndindex(rows, columns):
        assert maze.xy((row, column)) == tuple(official.cell_rowcol_to_xy(np.array([row, column])))
    for x, y in generator.uniform((-columns / 2, -rows / 2), (columns / 2, rows / 2), (200, 2)):
        assert maze.cell(x, y) == tuple(official.cell_xy_to_rowcol(np.array([x, y])))


def test_start_and_goal_of_the_paper() -> None:
    maze = Maze.of("medium")  # names may be written in lower case
    assert maze.xy((1, 1)) == (-2.5, 2.5)
    assert maze.xy((6, 6)) == (2.5, -2.5)


def test_the_shortest_path_of_medium() -> None:
    path = Maze.of("Medium").path((1, 1), (6, 6))
    assert path == ((1, 1), (1, 2), (2, 2), (3, 2), (3, 3), (3, 4), (4, 4), (4, 5), (4, 6), (5, 6), (6, 6))


def lengths(maze: Maze, goal: Cell) -> dict[Cell, int]:
    """Moves to the goal of every free cell, by relaxing all cells until nothing changes."""
    far = dict.fromkeys(maze.free, 10**6) | {goal: 0}
    for _ in maze.free:
        for (r, c), (i, j) in ((a, b) for a in maze.free for b in maze.free):
            if abs(r - i) + abs(c - j) == 1:
                far[r, c] = min(far[r, c], far[i, j] + 1)
    return far


@pytest.mark.parametrize("name", ["UMaze", "Medium"])
def test_paths_are_shortest(name: str) -> None:
    maze = Maze.of(name)
    for goal in maze.free[::5]:
        for start, moves in lengths(maze, goal).items():
            path = maze.path(start, goal)
            assert path[0] == start
            assert path[-1] == goal
            assert len(path) - 1 == moves
            assert all(abs(r - i) + abs(c - j) == 1 for (r, c), (i, j) in pairwise(path))


@pytest.mark.parametrize("name", [*OFFICIAL])
def test_what_lies_ahead_is_the_next_cell_of_the_path(name: str) -> None:
    maze = Maze.of(name)
    for goal in maze.free[::7]:
        ahead = maze.ahead(goal)
        assert [*ahead] == [*maze.free]
        assert all(there == maze.path(cell, goal)[:2][-1] for cell, there in ahead.items())


def test_nothing_lies_ahead_of_a_cell_without_a_way() -> None:
    assert Maze.of(["11111", "10101", "11111"]).ahead((1, 1)) == {(1, 1): (1, 1)}


def test_maps_of_ones_own() -> None:
    expected = ((True, True, True, True), (True, False, False, True), (True, True, True, True))
    for rows in (
        [[1, 1, 1, 1], [1, 0, 0, 1], [1, 1, 1, 1]],
        [[1, 1, 1, 1], [1, "r", "g", 1], [1, 1, 1, 1]],
        ["####", "#. #", "####"],
        ["1111", "10c1", "1111"],
        [1111, 1001, 1111],
    ):
        assert Maze.of(rows).walls == expected


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("Medum", "maze='Medum' is unknown: did you mean 'Medium'"),
        (["111", "1x1", "111"], "cell (1, 1) is 'x'; allowed are"),
        (["111", "10", "111"], "3 rows of [2, 3] cells; a map is a rectangle"),
        (["111", "111"], "2 rows of [3] cells; a map is a rectangle, 3 x 3 or more"),
        ([], "0 rows of [] cells"),
        (["111", "100", "111"], "could leave it at row 1: 2; the border must be wall"),
        (["111", "111", "111"], "every cell is a wall"),
    ],
)
def test_maps_that_cannot_be(rows: str | list[str], message: str) -> None:
    with pytest.raises(UserError, match=re.escape(message)):
        Maze.of(rows)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((0, 1), (1, 1), "start=(0, 1) is a wall of maze of your own; free cells are row 1: 1 3"),
        ((1, 1), (1, 2), "goal=(1, 2) is a wall"),
        ((1, 1), (9, 2), "goal=(9, 2) is outside the 3 x 5 cells"),
        ((1, -2), (1, 1), "start=(1, -2) is outside"),
        ((1, 1), (1, 3), "no path from start (1, 1) to goal (1, 3): only row 1: 1 can be reached"),
    ],
)
def test_ends_that_cannot_be(start: Cell, goal: Cell, message: str) -> None:
    with pytest.raises(UserError, match=re.escape(message)):
        Maze.of(["11111", "10101", "11111"]).path(start, goal)

"""The features against exact arithmetic: separating axes and sides of boxes in fractions, without slabs or floats."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.envs.pointmaze.geometry import Geometry
from credit.envs.pointmaze.maze import Cell, Maze

Point = tuple[Fraction, Fraction]
HALF = Fraction(1, 2) - Fraction(1, 10**6)


def point(x: float, y: float) -> Point:
    """Exactly these floats."""
    return Fraction(float(x)), Fraction(float(y))


def crosses(start: Point, end: Point, centre: Point) -> bool:
    """Whether a segment meets the inside of a wall: no axis, x, y or across the segment, separates the two."""
    for axis in range(2):
        low, high = sorted((start[axis], end[axis]))
        if high <= centre[axis] - HALF or low >= centre[axis] + HALF:
            return False
    along = (end[0] - start[0], end[1] - start[1])
    sides = [
        along[0] * (centre[1] + v * HALF - start[1]) - along[1] * (centre[0] + u * HALF - start[0])
        for u, v in itertools.product((-1, 1), repeat=2)
    ]
    return along == (0, 0) or min(sides) < 0 < max(sides)


def ahead(start: Point, direction: Point, centre: Point) -> Fraction | None:
    """The first t ≥ 0 at which start + t·direction is on a wall's outline, 0 inside, None if it misses the wall."""
    end = (start[0] + 1000 * direction[0], start[1] + 1000 * direction[1])
    if not crosses(start, end, centre):
        return None
    if all(abs(start[axis] - centre[axis]) < HALF for axis in range(2)):
        return Fraction(0)
    hits = []
    for axis, sign in itertools.product(range(2), (-1, 1)):
        if direction[axis]:
            t = (centre[axis] + sign * HALF - start[axis]) / direction[axis]
            other = start[1 - axis] + t * direction[1 - axis]
            if t >= 0 and abs(other - centre[1 - axis]) <= HALF:
                hits.append(t)
    return min(hits)


def brute(maze: Maze, goal: Cell, states: Tensor, actions: Tensor, cap: float) -> list[tuple[float, int, float]]:
    """The three features of every row, one wall after the other."""
    walls = [point(*maze.xy(cell)) for cell in maze.wall_cells]
    aim = maze.xy(goal)
    rows = []
    for (x, y, *_), (u, v) in zip(states.tolist(), actions.tolist(), strict=True):
        here, way = point(x, y), point(u, v) if (u, v) != (0, 0) else point(1, 0)
        hits = [t for wall in walls if (t := ahead(here, way, wall)) is not None]
        length = math.hypot(float(way[0]), float(way[1]))
        free = min([float(t) * length for t in hits], default=math.inf)
        count = sum(crosses(here, point(*aim), wall) for wall in walls)
        rows.append((math.dist((x, y), aim), count, min(free, cap)))
    return rows


def check(maze: Maze, goal: Cell, states: Tensor, actions: Tensor, cap: float = 8.0) -> Tensor:
    found = Geometry(maze, goal, cap).features(states, actions)
    expected = torch.tensor(brute(maze, goal, states, actions, cap), dtype=torch.float64)
    assert found.dtype == torch.float64
    assert torch.equal(found[:, 1], expected[:, 1])
    torch.testing.assert_close(found, expected, atol=1e-9, rtol=0)
    return found


@pytest.mark.parametrize(("name", "goal"), [("UMaze", (3, 1)), ("Medium", (6, 6)), ("Large", (7, 10))])
def test_random_rows(name: str, goal: Cell) -> None:
    maze = Maze.of(name)
    rows, columns = maze.grid.shape
    generator = torch.Generator().manual_seed(0)
    states = (torch.rand(120, 4, generator=generator) - 0.5) * torch.tensor([columns, rows, 10, 10])
    found = check(maze, goal, states, torch.rand(120, 2, generator=generator) * 2 - 1)
    assert len(found[:, 1].unique()) > 2


def test_positions_on_corners_edges_and_middles() -> None:
    """Every half metre, so that lines touch corners and run along walls; actions along axes, diagonals and nowhere."""
    maze = Maze.of("UMaze")
    ways = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -0.5), (1, 1), (-0.3, 0.3), (0.5, -1), (1e-30, 1), (-1, 1e-310)]
    places = itertools.product(np.arange(-2.5, 2.75, 0.5), repeat=2)
    pairs = list(itertools.product(places, ways))
    states = torch.tensor([(*place, 0, 0) for place, _ in pairs], dtype=torch.float64)
    actions = torch.tensor([way for _, way in pairs], dtype=torch.float64)
    check(maze, (3, 1), states, actions)


def test_lines_that_pass_a_corner_closely() -> None:
    maze = Maze.of("Medium")
    slips = torch.tensor([-1e-2, -1e-4, -5e-6, 0, 5e-6, 1e-4, 1e-2], dtype=torch.float64)
    states = torch.zeros(len(slips), 4, dtype=torch.float64)
    states[:, 0], states[:, 1] = -2.5 + slips, 2.5
    found = check(maze, (6, 6), states, torch.tensor([[1.0, -1.0]]).double().expand(len(slips), 2))
    assert found[:, 1].min() == 1
    assert found[:, 1].max() > 1


def test_by_hand() -> None:
    geometry = Geometry(Maze.of("Medium"), (6, 6))
    states = torch.tensor([[-2.5, 2.5, 0, 0], [2.5, -2.5, 3, 3], [2.5, -0.5, 0, 0], [-2.5, 2.5, 0, 0]])
    actions = torch.tensor([[0.0, 0.0], [0.0, 0.2], [-1.0, 0.0], [0.5, -0.5]])
    expected = [
        [50**0.5, 1, 1.5],  # the diagonal touches corners, and passes through the wall at (5, 5) alone
        [0, 0, 2.5],  # at the goal; two cells up is free
        [2, 0, 2.5],  # (4, 6) looks left over (4, 5) and (4, 4) to the wall (4, 3)
        [50**0.5, 1, 24.5**0.5],  # three and a half diagonals from the middle of (1, 1) to the corner of (5, 5)
    ]
    torch.testing.assert_close(geometry.features(states, actions), torch.tensor(expected).double(), atol=2e-6, rtol=0)


def test_the_cap() -> None:
    maze = Maze.of(["1" * 14, "1" + "0" * 12 + "1", "1" * 14])
    states, actions = torch.tensor([[-5.5, 0.0, 0, 0]]), torch.tensor([[0.1, 0.0]])
    assert Geometry(maze, (1, 12)).next_wall(states, actions).item() == 8
    assert Geometry(maze, (1, 12), cap=20).next_wall(states, actions).item() == pytest.approx(11.5, abs=2e-6)


def test_rows_do_not_depend_on_how_many_there_are() -> None:
    generator = torch.Generator().manual_seed(1)
    states, actions = torch.rand(3000, 4, generator=generator) * 6 - 3, torch.rand(3000, 2, generator=generator) - 0.5
    geometry = Geometry(Maze.of("Medium"), (6, 6))
    whole = geometry.features(states, actions)
    parts = [geometry.features(*pair) for pair in zip(states.split(7), actions.split(7), strict=True)]
    assert torch.equal(whole, torch.cat(parts))
    assert geometry.features(states[:0], actions[:0]).shape == (0, 3)


@pytest.mark.parametrize("name", ["UMaze", "Medium", "Large"])
def test_cells(name: str) -> None:
    maze = Maze.of(name)
    geometry = Geometry(maze, maze.free[0])
    rows, columns = maze.grid.shape
    generator = torch.Generator().manual_seed(2)
    states = (torch.rand(500, 4, generator=generator) - 0.5) * torch.tensor([columns, rows, 1, 1])
    for (x, y, *_), found in zip(states.tolist(), geometry.cells(states).tolist(), strict=True):
        cell = maze.cell(x, y)
        if maze.is_free(cell):
            assert maze.free[found] == cell
        else:
            middle = maze.xy(cell)
            assert math.dist(maze.xy(maze.free[found]), middle) == min(math.dist(maze.xy(c), middle) for c in maze.free)
    centres = torch.tensor([(*maze.xy(cell), 0, 0) for cell in maze.free])
    assert geometry.cells(centres).tolist() == list(range(len(maze.free)))
    assert geometry.cells(torch.tensor([[-99.0, 99.0, 0, 0]])).tolist() == [0]  # outside: nearest the upper left corner


def test_the_goal_must_be_free() -> None:
    with pytest.raises(UserError, match=r"goal=\(0, 0\) is a wall"):
        Geometry(Maze.of("Medium"), (0, 0))

"""What reward models look at in a maze, built as a configuration builds it."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.features import MazeCells, MazeGeometry
from credit.envs.pointmaze.maze import Maze
from credit.recovery.features.motion import Motion

MAP = ["11111", "10001", "10101", "11111"]


@pytest.fixture
def problem() -> Problem:
    return Problem.vectors(4, 2, 300, (0, 1))


@pytest.fixture
def moves() -> Steps:
    """Balls in every free cell, some of them anywhere in it."""
    generator = torch.Generator().manual_seed(0)
    maze = Maze.of(MAP)
    centres = torch.tensor([maze.xy(cell) for cell in maze.free]).repeat(20, 1).float()
    places = centres + (torch.rand(centres.shape, generator=generator) - 0.5) * 0.99
    states = torch.cat([places, torch.randn(places.shape, generator=generator)], 1)
    actions = torch.rand(places.shape, generator=generator) * 2 - 1
    return Steps(states, actions, states)


KNOWN = PointMaze(MAP, start=(1, 1), goal=(2, 3)).knowledge()


def test_motion_is_state_and_action(problem: Problem, moves: Steps) -> None:
    features = Motion()
    features.start(problem)
    found = features(moves)
    assert found.dtype == torch.float32
    assert torch.equal(found[:, :4], moves.states)
    assert torch.equal(found[:, 4:], moves.actions)


def test_cells_are_those_that_the_maze_names(problem: Problem, moves: Steps) -> None:
    features = MazeCells()
    features.learn(KNOWN)
    features.start(problem)
    found, maze = features(moves), Maze.of(MAP)
    assert found.dtype == torch.bool
    assert found.shape == (len(moves.states), 5)
    for row, (x, y, *_) in zip(found.tolist(), moves.states.tolist(), strict=True):
        expected = [0.0] * 5
        expected[list(maze.free).index(maze.cell(x, y))] = 1.0
        assert row == expected


def test_geometry_knows_goal_walls_and_way_ahead(problem: Problem) -> None:
    features = MazeGeometry()
    features.learn(KNOWN)
    features.start(problem)
    maze = Maze.of(MAP)
    (x, y), (goal_x, goal_y) = maze.xy((2, 1)), maze.xy((2, 3))
    state = torch.tensor([[x, y, 0.0, 0.0], [goal_x, goal_y, 1.0, 1.0]])
    action = torch.tensor([[0.0, 1.0], [0.0, -0.2]])
    found = features(Steps(state, action, state))
    assert found.dtype == torch.float32
    expected = [[2.0, 1.0, 1.5], [0.0, 0.0, 0.5]]  # one wall between the two; free above, a wall below
    torch.testing.assert_close(found, torch.tensor(expected), atol=1e-5, rtol=0)


@pytest.mark.parametrize("features", [MazeCells(), MazeGeometry()])
def test_rows_may_have_any_leading_dimensions(problem: Problem, moves: Steps, features: Any) -> None:
    features.learn(KNOWN)
    grid = Steps(*(part.view(5, -1, part.shape[-1]) for part in (moves.states, moves.actions, moves.next_states)))
    assert torch.equal(features(grid).flatten(0, 1), features(moves))


@pytest.mark.parametrize("features", [MazeCells(), MazeGeometry()])
def test_without_a_map_nothing_starts(problem: Problem, features: Any) -> None:
    with pytest.raises(UserError, match=rf"{type(features).__name__} has no map yet: call learn"):
        features.start(problem)

"""What reward models look at in a maze, built as a configuration builds it."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from credit.config import schema
from credit.core.trajectories import ContinuousProblem, Moves
from credit.envs.pointmaze.environment import PointMaze
from credit.envs.pointmaze.features import MazeCells, MazeGeometry
from credit.envs.pointmaze.maze import Maze
from credit.recovery.features.motion import Motion
from credit.recovery.models.neural import NeuralModel
from credit.recovery.models.step_linear import StepLinear

MAP = ["11111", "10001", "10101", "11111"]


@pytest.fixture
def problem() -> ContinuousProblem:
    return ContinuousProblem(4, 2, 300, (0, 1), torch.device("cpu"))


@pytest.fixture
def moves() -> Moves:
    """Balls in every free cell, some of them anywhere in it."""
    generator = torch.Generator().manual_seed(0)
    maze = Maze.of(MAP)
    centres = torch.tensor([maze.xy(cell) for cell in maze.free]).repeat(20, 1).float()
    places = centres + (torch.rand(centres.shape, generator=generator) - 0.5) * 0.99
    states = torch.cat([places, torch.randn(places.shape, generator=generator)], 1)
    actions = torch.rand(places.shape, generator=generator) * 2 - 1
    return Moves(states, actions, states, torch.zeros(len(states), dtype=torch.int64))


def env() -> PointMaze:
    return PointMaze(MAP, start=(1, 1), goal=(2, 3))


def test_motion_is_state_and_action(problem: ContinuousProblem, moves: Moves) -> None:
    features = Motion()
    features.start(problem)
    found = features(moves)
    assert found.dtype == torch.float32
    assert torch.equal(found[:, :4], moves.states)
    assert torch.equal(found[:, 4:], moves.actions)


def test_cells_are_those_that_the_maze_names(problem: ContinuousProblem, moves: Moves) -> None:
    features = MazeCells(env())
    features.start(problem)
    found, maze = features(moves), Maze.of(MAP)
    assert found.dtype == torch.float32
    assert found.shape == (len(moves), 5)
    for row, (x, y, *_) in zip(found.tolist(), moves.states.tolist(), strict=True):
        expected = [0.0] * 5
        expected[list(maze.free).index(maze.cell(x, y))] = 1.0
        assert row == expected


def test_geometry_knows_goal_walls_and_way_ahead(problem: ContinuousProblem) -> None:
    features = MazeGeometry(env())
    features.start(problem)
    maze = Maze.of(MAP)
    (x, y), (goal_x, goal_y) = maze.xy((2, 1)), maze.xy((2, 3))
    state = torch.tensor([[x, y, 0.0, 0.0], [goal_x, goal_y, 1.0, 1.0]])
    action = torch.tensor([[0.0, 1.0], [0.0, -0.2]])
    found = features(Moves(state, action, state, torch.zeros(2, dtype=torch.int64)))
    assert found.dtype == torch.float32
    expected = [[2.0, 1.0, 1.5], [0.0, 0.0, 0.5]]  # one wall between the two; free above, a wall below
    torch.testing.assert_close(found, torch.tensor(expected), atol=1e-5, rtol=0)


def test_models_get_their_maze_from_the_environment(problem: ContinuousProblem, moves: Moves) -> None:
    maze = {"_target_": "credit.envs.pointmaze.environment.PointMaze", "maze": MAP, "start": [1, 1], "goal": [2, 3]}
    folder = "credit.envs.pointmaze.features"
    config: dict[str, Any] = {
        "env": maze,
        "uncertainty": {"_target_": "credit.recovery.uncertainty.networks.Dropout"},
        "surrogates": {
            "box": {
                "_target_": "credit.recovery.models.step_linear.StepLinear",
                "name": "box",
                "features": {"_target_": f"{folder}.MazeCells"},
            },
            "heuristic": {
                "_target_": "credit.recovery.models.neural.NeuralModel",
                "name": "heuristic",
                "features": {"_target_": f"{folder}.MazeGeometry"},
            },
        },
    }
    built = schema.build(config, "surrogates")
    box, heuristic = built["box"], built["heuristic"]
    assert isinstance(box, StepLinear)
    assert isinstance(heuristic, NeuralModel)
    assert box.features.env is heuristic.features.env
    for model, size in ((box, 5), (heuristic, 3)):
        model.start(problem)
        assert model.features(moves).shape == (len(moves), size)

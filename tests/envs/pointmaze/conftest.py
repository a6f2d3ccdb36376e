"""Small tasks."""

from __future__ import annotations

import pytest

from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.task import Task


@pytest.fixture(scope="session")
def medium() -> Task:
    """The paper's task."""
    return Task(Maze.of("Medium"), (1, 1), (6, 6), 300)


@pytest.fixture(scope="session")
def corridor() -> Task:
    """Three free cells in a row, which take about 50 steps."""
    return Task(Maze.of(["11111", "10001", "11111"]), (1, 1), (1, 3), 80)

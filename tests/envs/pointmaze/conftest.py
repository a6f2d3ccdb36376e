"""Small tasks, and a policy that finds the goal, as a function of the observation alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import Tensor

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


@pytest.fixture
def navigator() -> Callable[[Task, Sequence[float]], TensorDictModule]:
    """`navigator(task, strength)`: towards the next cell on the shortest path, with a strength for each ball."""

    def make(task: Task, strength: Sequence[float]) -> TensorDictModule:
        def act(states: Tensor) -> Tensor:
            actions = []
            for (x, y, vx, vy), scale in zip(states.tolist(), strength, strict=True):
                path = task.maze.path(task.maze.cell(x, y), task.goal)
                ahead = np.array(task.maze.xy(path[min(1, len(path) - 1)]))
                force = 6 * (ahead - np.array([x, y])) - 0.6 * np.array([vx, vy])
                actions.append(np.clip(force, -1, 1) * scale)
            return torch.tensor(np.array(actions), dtype=torch.float32)

        return TensorDictModule(act, in_keys=["observation"], out_keys=["action"])

    return make

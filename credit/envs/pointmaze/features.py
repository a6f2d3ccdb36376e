"""Feature maps on a maze, for the structured surrogates (3.3, 6.3)."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.interfaces import FeatureMap
from credit.core.trajectories import ContinuousProblem, Moves
from credit.envs.pointmaze.environment import PointMaze


class _OfMaze(FeatureMap):
    """What reads a map."""

    domain: ClassVar = "continuous"
    needs: ClassVar = {"env": PointMaze}

    def __init__(self, env: PointMaze) -> None:
        self.env = env

    def start(self, problem: ContinuousProblem) -> None:
        """Lay out the map."""
        self.geometry = self.env.geometry


class MazeCells(_OfMaze):
    """One feature a free cell, that of the state: a ridge on them is the box surrogate.

    Args:
        env: the maze; taken from the environment.
    """

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        """One-hot rows [N, free cells], float32, in the order of `maze.free`."""
        cells = self.geometry.cells(steps.states)
        return torch.nn.functional.one_hot(cells, len(self.env.maze.free)).float()


class MazeGeometry(_OfMaze):
    """What a person would look at: (d_goal, n_wall, d_next_wall), the features of the heuristic surrogate (6.3).

    Args:
        env: the maze and its nominal goal; taken from the environment.
    """

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        """Rows [N, 3], float32: distance to the goal (m), wall cells on the line to it, way to the next wall (m)."""
        return self.geometry.features(steps.states, steps.actions).float()

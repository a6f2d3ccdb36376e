"""Feature maps on a maze, for the structured surrogates (3.3, 6.3)."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.envs.pointmaze.geometry import Geometry


class _OfMaze(FeatureMap):
    """What reads a map."""

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"
    knows: ClassVar = Geometry

    def learn(self, knowledge: Geometry) -> None:
        """Lay out the map."""
        self.geometry = knowledge

    def start(self, problem: Problem) -> None:
        """The map is all."""


class MazeCells(_OfMaze):
    """One feature a free cell, that of the state: a ridge on them is the box surrogate."""

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot rows [..., free cells], bool, in the order of `maze.free`."""
        cells = self.geometry.cells(steps.states.flatten(0, -2)).view(steps.states.shape[:-1])
        return torch.nn.functional.one_hot(cells, len(self.geometry.maze.free)).bool()


class MazeGeometry(_OfMaze):
    """What a person would look at: (d_goal, n_wall, d_next_wall), the features of the heuristic surrogate (6.3)."""

    def __call__(self, steps: Steps) -> Tensor:
        """Rows [..., 3], float32: distance to the goal (m), wall cells on the line to it, way to the next wall (m)."""
        states, actions = steps.states.flatten(0, -2), steps.actions.flatten(0, -2)
        return self.geometry.features(states, actions).float().view(*steps.states.shape[:-1], 3)

"""Feature maps on a maze, for the structured surrogates (3.3, 6.3)."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.envs.pointmaze.geometry import Geometry, MazeKnowledge


class _OfMaze(FeatureMap):
    """What reads a map."""

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"
    knows: ClassVar = MazeKnowledge
    keeps: ClassVar = ()
    _geometry: Geometry | None = None

    def learn(self, knowledge: MazeKnowledge) -> None:
        """Lay out the map."""
        self._geometry = knowledge.geometry

    def start(self, problem: Problem) -> None:
        """Nothing to learn of the sizes.

        Raises:
            UserError: nobody told it the map.
        """
        _ = self.geometry

    @property
    def geometry(self) -> Geometry:
        """The map, laid out."""
        if self._geometry is None:
            raise UserError(f"{type(self).__name__} has no map yet: call learn(env.knowledge()) before start")
        return self._geometry


class MazeCells(_OfMaze):
    """One feature a free cell, that of the state: a ridge on them is the box surrogate."""

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot rows [..., free cells], bool, in the order of `maze.free`."""
        cells = self.geometry.cells(steps.states)
        return torch.nn.functional.one_hot(cells, len(self.geometry.maze.free)).bool()


class MazeGeometry(_OfMaze):
    """What a person would look at: (d_goal, n_wall, d_next_wall), the features of the heuristic surrogate (6.3)."""

    def __call__(self, steps: Steps) -> Tensor:
        """Rows [..., 3], float32: distance to the goal (m), wall cells on the line to it, way to the next wall (m)."""
        return self.geometry.features(steps.states, steps.actions).float()

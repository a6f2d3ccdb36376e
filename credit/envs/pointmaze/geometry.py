"""What a person knows about a maze: distance to the goal, walls on the line to it, free way ahead; and the cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from credit.core.problem import FLOAT
from credit.core.tensors import CACHED
from credit.envs.pointmaze.maze import Cell, Maze

SLACK = 1e-6  # m; walls are that much smaller on every side, so that to touch a corner or a side is not to cross it
TINY = 1e-300  # stands for 0 in a direction: a line parallel to an axis stays between two sides for ever, or never


class Geometry:
    """Features of states [..., 4] and actions [..., 2] in one maze, float64, on the device of their arguments.

    Args:
        maze: the map.
        goal: the nominal goal; its noise is not known to a learner.
        cap: the longest distance (m) to a wall that is told apart.
    """

    def __init__(self, maze: Maze, goal: Cell, cap: float = 8.0) -> None:
        maze.require_free("goal", goal)
        self.maze, self.cap = maze, cap
        self.goal = torch.tensor(maze.xy(goal), dtype=FLOAT)
        self.walls = torch.tensor([maze.xy(cell) for cell in maze.wall_cells], dtype=FLOAT)
        free = torch.tensor([maze.xy(cell) for cell in maze.free], dtype=FLOAT)
        rows, columns = maze.grid.shape
        centres = torch.tensor([maze.xy((r, c)) for r in range(rows) for c in range(columns)], dtype=FLOAT)
        self._numbers = torch.cdist(centres, free).argmin(-1)  # a wall cell has the number of the nearest free one

    def features(self, states: Tensor, actions: Tensor) -> Tensor:
        """φ_neur = (d_goal, n_wall, d_next_wall) [..., 3] of section 6.3; m, cells, m."""
        return torch.stack(
            (self.goal_distance(states), self.walls_to_goal(states), self.next_wall(states, actions)), dim=-1
        )

    def goal_distance(self, states: Tensor) -> Tensor:
        """d_goal [...]: straight distance (m) to the nominal goal."""
        return torch.linalg.vector_norm(self.goal.to(states.device) - states[..., :2].to(FLOAT), dim=-1)

    def walls_to_goal(self, states: Tensor) -> Tensor:
        """n_wall [...]: how many wall cells the straight line to the nominal goal passes through."""
        origins = states[..., :2].to(FLOAT).flatten(0, -2)
        parts = [
            (enter.clamp(min=0) < leave.clamp(max=1)).sum(-1)
            for enter, leave in self._spans(origins, self.goal.to(origins.device) - origins)
        ]
        return torch.cat(parts).to(FLOAT).view(states.shape[:-1])

    def next_wall(self, states: Tensor, actions: Tensor) -> Tensor:
        """d_next_wall [...]: way (m) along the action to the next wall, at most `cap`; no action looks along +x."""
        force = actions.to(FLOAT).flatten(0, -2)
        length = torch.hypot(force[:, 0], force[:, 1]).unsqueeze(-1)
        ahead = torch.where(length > 0, force / length, force.new_tensor((1.0, 0.0)))
        parts = [
            torch.where((enter < leave) & (leave > 0), enter.clamp(min=0), torch.inf).amin(-1)
            for enter, leave in self._spans(states[..., :2].to(FLOAT).flatten(0, -2), ahead)
        ]
        return torch.cat(parts).clamp(max=self.cap).view(states.shape[:-1])

    def cells(self, states: Tensor) -> Tensor:
        """c(s) [...]: number of the free cell in `maze.free`; the nearest one for a position in a wall or outside."""
        rows, columns = self.maze.grid.shape
        x, y = states[..., 0].to(FLOAT), states[..., 1].to(FLOAT)
        row = torch.floor(rows / 2 - y).long().clamp(0, rows - 1)
        column = torch.floor(x + columns / 2).long().clamp(0, columns - 1)
        return self._numbers.to(states.device)[row * columns + column]

    def _spans(self, origins: Tensor, directions: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
        """Where lines o + t·d enter and leave each of W walls: pairs of t [part of N, W], enter < leave where they do.

        The slab test (Kay and Kajiya 1986): a line is in a box while it is between its sides on both axes. Done in
        parts of N that stay in the cache.
        """
        walls = self.walls.to(origins.device).T.unsqueeze(1)  # [2, 1, W]
        pace = torch.where(directions.abs() < TINY, TINY, directions).reciprocal()
        size = max(1, CACHED // (16 * walls.shape[-1]))
        for o, p in zip(origins.T.split(size, dim=1), pace.T.split(size, dim=1), strict=True):
            x, y = (walls - o.unsqueeze(-1)) * p.unsqueeze(-1)
            half_x, half_y = p.abs().unsqueeze(-1) * (0.5 - SLACK)
            yield torch.maximum(x - half_x, y - half_y), torch.minimum(x + half_x, y + half_y)


@dataclass(frozen=True)
class MazeKnowledge:
    """What a person knows about a maze: its map and the nominal goal.

    Attributes:
        maze: the map. goal: the cell of the goal. cap: the longest distance (m) to a wall that is told apart.
    """

    maze: Maze
    goal: Cell
    cap: float = 8.0

    @property
    def geometry(self) -> Geometry:
        """Distances, walls and cells."""
        return Geometry(self.maze, self.goal, self.cap)

"""What is asked of the ball: from one cell to another within a horizon; and the least time that this takes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import pi

import numpy as np

from credit.core.errors import UserError
from credit.envs.pointmaze.maze import Cell, Maze

# Facts of the simulated ball (a sphere of .1 m and density 1000, two motors, damped joints); lengths in m, time in s.
NOISE, RADIUS = 0.25, 0.45  # start and goal move by ±NOISE on each axis; success is within RADIUS of the goal
TIMESTEP, TOP_SPEED, FORCE, DAMPING, MASS = 0.01, 5.0, 100.0, 1.0, 4000 / 3 * pi * 0.1**3


@dataclass(frozen=True)
class Task:
    """From `start` to `goal` in at most `horizon` steps (27).

    Args:
        maze: the map. start, goal: cells (row, column). horizon: H, steps of .01 s.

    Raises:
        UserError: start or goal in a wall, both the same, no path between them, a horizon that no controller can meet.
    """

    maze: Maze
    start: Cell
    goal: Cell
    horizon: int

    def __post_init__(self) -> None:
        if self.start == self.goal:
            raise UserError(f"start={self.start} is the goal too; they must be two cells")
        path = self.path
        if self.horizon < self.least_steps:
            raise UserError(
                f"horizon={self.horizon} is too short: the shortest path from {self.start} to {self.goal} has "
                f"{len(path) - 1} moves, which takes at least {self.least_steps} steps at full speed; "
                f"a controller that brakes at corners takes about twice as many; take a larger feedback.window"
            )

    @property
    def path(self) -> tuple[Cell, ...]:
        """A shortest path over the sides of cells, both ends included."""
        return self.maze.path(self.start, self.goal)

    @property
    def least_steps(self) -> int:
        """Steps below which nothing reaches the goal, wherever start and goal are moved by the noise.

        The way is measured in the larger of its two coordinates, since either axis has its own speed limit; both ends
        may be NOISE nearer, and RADIUS is near enough. That way is driven in a straight line from rest.
        """
        return fastest(clearance(self.maze, self.start, self.goal) - 2 * NOISE - RADIUS)


def fastest(distance: float) -> int:
    """The fewest steps from rest that cover a distance (m) along one axis at full force, at least 1.

    A step clips the speed to TOP_SPEED, adds what the force gives (damping is integrated implicitly), and moves.
    """
    steps, covered, speed = 0, 0.0, 0.0
    while covered < distance or steps == 0:
        speed = min(speed, TOP_SPEED)
        speed += TIMESTEP * (FORCE - DAMPING * speed) / (MASS + TIMESTEP * DAMPING)
        covered += TIMESTEP * speed
        steps += 1
    return steps


def clearance(maze: Maze, start: Cell, goal: Cell) -> float:
    """Length (m) of the shortest way between two centres for a point, measured by the larger coordinate of each piece.

    A lattice of half metres holds all centres and all corners of walls, between which a shortest way is straight; such
    a piece is as long as the same number of lattice moves, straight or diagonal, through the free squares it touches.
    The ball does not fit through a corner in which two walls touch.
    """
    free = np.kron(~maze.grid, np.ones((2, 2), dtype=bool))  # squares of half a metre; node (i, j) is a square's corner
    around = free[:-1, :-1] * 1 + free[:-1, 1:] * 2 + free[1:, :-1] * 4 + free[1:, 1:] * 8  # of node (i + 1, j + 1)
    pinched = {(int(i) + 1, int(j) + 1) for i, j in np.argwhere((around == 1 + 8) | (around == 2 + 4))}
    source, target = ((2 * r + 1, 2 * c + 1) for r, c in (start, goal))
    steps = {source: 0}
    queue = deque([source])
    while target not in steps:
        i, j = queue.popleft()
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                there = (i + down, j + right)
                rows = {min(i, there[0]), max(i, there[0]) - 1}
                columns = {min(j, there[1]), max(j, there[1]) - 1}
                if there not in steps and there not in pinched and any(free[r, c] for r in rows for c in columns):
                    steps[there] = steps[i, j] + 1
                    queue.append(there)
    return steps[target] / 2

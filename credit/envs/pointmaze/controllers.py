"""The seeded controllers behind the demonstrations: along way-points with noise, and from some point on at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from credit.core.ranges import NonNegative, Positive, PositiveInt
from credit.envs.pointmaze.physics import Balls
from credit.envs.pointmaze.task import Task

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Path:
    """One trajectory of L steps: states [L + 1, 4], actions [L, 2], and whether it ends at the goal."""

    states: Floats
    actions: Floats
    success: bool


@dataclass(frozen=True)
class Controller:
    """Steers by a_t = clip(kp·(way-point − position) − kd·velocity + σ·noise), later at random.

    Args:
        kp: pull towards the way-point, per metre. kd: brake, per metre a second. sigma: sd of the noise of every step.
        switch: distance (m) at which the next way-point takes over. hold: steps that a random action is kept.
    """

    kp: Positive = 6.0
    kd: NonNegative = 0.6
    sigma: NonNegative = 0.3
    switch: Positive = 0.4
    hold: PositiveInt = 15

    def drive(self, task: Task, legs: Sequence[int], generators: Sequence[np.random.Generator]) -> list[Path]:
        """Drive n balls side by side; each depends on its own generator and legs alone.

        Args:
            task: start, goal, horizon.
            legs: how many way-points (cells of the shortest path after the start) each follows before it goes random.
            generators: one a ball, for the noise of the environment and of the controller.
        """
        balls = Balls(task, generators)
        balls.reset()
        n, horizon = len(balls), task.horizon
        points = np.array([task.maze.xy(cell) for cell in task.path[1:]])
        noise: NDArray[np.float64] = np.stack([self.sigma * g.standard_normal((horizon, 2)) for g in generators])
        random: NDArray[np.float64] = np.stack([g.uniform(-1, 1, (-(-horizon // self.hold), 2)) for g in generators])
        limit = np.where(np.asarray(legs) < len(points), legs, horizon)  # past the last way-point it stays on that one
        leg, wandered, every = np.zeros(n, dtype=int), np.zeros(n, dtype=int), np.arange(n)
        states: list[Floats] = [balls.states.astype(np.float32)]
        actions: list[Floats] = []
        moving = every
        while len(moving):
            target, place, speed = points[np.minimum(leg, len(points) - 1)], balls.states[:, :2], balls.states[:, 2:]
            steered = self.kp * (target - place) - self.kd * speed + noise[:, len(actions)]
            lost = leg >= limit
            action = np.where(lost[:, None], random[every, wandered // self.hold], np.clip(steered, -1, 1))
            actions.append(action.astype(np.float32))
            balls.step(actions[-1], moving.tolist())
            states.append(balls.states.astype(np.float32))
            wandered += lost
            leg += ~lost & (np.linalg.norm(balls.states[:, :2] - target, axis=-1) < self.switch)
            moving = np.flatnonzero((balls.elapsed == len(actions)) & ~balls.reached & (len(actions) < horizon))
        path, force = np.stack(states, axis=1), np.stack(actions, axis=1)
        lengths, success = balls.elapsed, balls.reached
        return [Path(path[i, : lengths[i] + 1], force[i, : lengths[i]], bool(success[i])) for i in range(n)]

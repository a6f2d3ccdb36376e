"""The ball itself: n PointMaze simulations stepped in lock-step, bit-equal to Gymnasium-Robotics'."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from credit.core.errors import RunError
from credit.envs.pointmaze.maze import Maze, robotics
from credit.envs.pointmaze.task import NOISE, RADIUS, TOP_SPEED, Task

HEIGHT = 0.4  # of the walls (m)
STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)  # x, y, vx, vy: the paper's s_t


class Noise(Protocol):
    """What moves start and goal: a NumPy generator."""

    def uniform(self, low: float, high: float) -> float:
        """A number in [low, high)."""


class Balls:
    """n simulations of one task: one MuJoCo model, n states, and a goal, a clock and a generator for each; reset first.

    A copy, or what was pickled, goes on bit for bit like the original.

    The Gymnasium environment does more work for the same numbers: it runs the whole forward dynamics once more after
    clipping the speed, although nothing but `qvel` has changed and the step starts with them anyway.

    Args:
        task: where to start and where to go.
        noise: one generator a simulation; a reset draws goal x, goal y, start x, start y, as Gymnasium's does.

    Attributes:
        states: x, y, vx, vy [n, 4]. goals: [n, 2]. elapsed: steps since the reset [n].
    """

    def __init__(self, task: Task, noise: Sequence[Noise]) -> None:
        self.task = task
        self.noise: list[Noise] = list(noise)
        self.model = model(task.maze)
        self.states: NDArray[np.float64] = np.zeros((len(self.noise), 4))
        self.goals = np.zeros((len(self.noise), 2))
        self.elapsed = np.zeros(len(self.noise), dtype=np.int64)
        self._data = [mujoco.MjData(self.model) for _ in self.noise]
        self._bind()

    def _bind(self) -> None:
        self._handles: list[tuple[Any, NDArray[np.float64], NDArray[np.float64]]] = [
            (data, data.ctrl, row) for data, row in zip(self._data, self.states, strict=True)
        ]

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_handles"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind()  # a copied view would no longer show what it was a view of

    def __len__(self) -> int:
        return len(self.noise)

    def reset(self, which: Iterable[int] | None = None) -> None:
        """Put some simulations, or all, back to the start, with new noise on goal and start."""
        for i in range(len(self)) if which is None else which:
            self.goals[i] = self._moved(i, self.task.maze.xy(self.task.goal))
            data = self._data[i]
            mujoco.mj_resetData(self.model, data)
            data.qpos[:] = self._moved(i, self.task.maze.xy(self.task.start))
            mujoco.mj_forward(self.model, data)
            self.states[i, :2], self.states[i, 2:] = data.qpos, 0
            self.elapsed[i] = 0

    def step(self, actions: ArrayLike, which: Iterable[int] | None = None) -> None:
        """Push the balls, .01 s: `states` and `elapsed` change in place.

        Args:
            actions: forces [n, 2], clipped to [-1, 1].
            which: the simulations that move, or all.

        Raises:
            RunError: a force that is not a number.
        """
        forces: NDArray[Any] = np.clip(np.asarray(actions), -1.0, 1.0)
        finite: NDArray[np.bool_] = np.isfinite(forces).all(-1)
        if not finite.all():
            i = int(finite.argmin())
            raise RunError(f"PointMaze {i} got the action {forces[i].tolist()} in state {self.states[i].tolist()}")
        speeding = np.abs(self.states[:, 2:]).max(-1) > TOP_SPEED
        moving = list(range(len(self)) if which is None else which)
        model, step, read = self.model, mujoco.mj_step, mujoco.mj_getState
        for i in moving:
            data, control, row = self._handles[i]
            control[:] = forces[i]
            if speeding[i]:
                data.qvel[:] = np.clip(row[2:], -TOP_SPEED, TOP_SPEED)
            step(model, data)
            read(model, data, row, STATE)
        self.elapsed[moving] += 1

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance (m) of every ball to its own goal [n]."""
        return np.linalg.norm(self.states[:, :2] - self.goals, axis=-1)

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Whether the ball is at its goal now [n]."""
        return self.distances <= RADIUS

    def _moved(self, i: int, centre: tuple[float, float]) -> tuple[float, float]:
        x = centre[0] + self.noise[i].uniform(-NOISE, NOISE)
        return x, centre[1] + self.noise[i].uniform(-NOISE, NOISE)


def noise(seeds: Sequence[int], copies: int, purpose: str) -> list[Noise]:
    """A generator for each of K copies of each replica, which depends on (seed, copy, purpose) alone."""
    key = zlib.crc32(f"pointmaze {purpose}".encode())
    return [
        np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, copy)))
        for seed in seeds
        for copy in range(copies)
    ]


@cache
def model(maze: Maze) -> Any:
    """Gymnasium-Robotics' ball among walls, as an MjModel with a site named `target` to draw the goal at."""
    tree = ET.parse(robotics("envs/assets/point/point.xml"))
    world = tree.find(".//worldbody")
    assert world is not None
    for row, column in maze.wall_cells:
        x, y = maze.xy((row, column))
        box: dict[str, Any] = {
            "type": "box",
            "pos": f"{x} {y} {HEIGHT / 2}",
            "size": f"0.5 0.5 {HEIGHT / 2}",
            "rgba": "0.7 0.5 0.3 1.0",
        }
        ET.SubElement(world, "geom", name=f"block_{row}_{column}", contype="1", conaffinity="1", **box)
    ET.SubElement(world, "site", name="target", type="sphere", size="0.2", pos=f"0 0 {HEIGHT / 2}", rgba="1 0 0 0.7")
    return mujoco.MjModel.from_xml_string(ET.tostring(tree.getroot(), encoding="unicode"))

"""Frames of a policy in its maze, as mp4. Run as a program: a missing OpenGL library can end the process.

    MUJOCO_GL=egl python -m credit.report.pointmaze.render '[["<trajectories.npz>", "<file>.mp4"], ...]'

prints READY as soon as a frame could be drawn.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.physics import HEIGHT, model
from credit.report.video import write_video

EPISODES = 3
EVERY, FPS = 4, 25  # a step is .01 s: real time
PAUSE = 12  # frames that the end of an episode stays
SIZE = 400  # pixels; divisible by 16, as H.264 wants it
BALL, TRAIL = (0.1, 0.45, 0.9, 1.0), (0.1, 0.45, 0.9, 0.5)
TRAIL_SIZE = np.array([0.04, 0.0, 0.0])
UPRIGHT = np.eye(3).ravel()


class Painter:
    """Draws the ball of one maze from above.

    Args:
        maze: its walls.
    """

    def __init__(self, maze: Maze) -> None:
        self._model = model(maze)
        self._model.site("particle_site").rgba[:] = BALL  # twice the size of the ball, which is transparent
        self._data = mujoco.MjData(self._model)
        self._renderer = mujoco.Renderer(self._model, SIZE, SIZE)
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = (0.0, -0.2, 0.0)
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 1.32 * max(maze.grid.shape), 90, -75

    def frames(self, states: NDArray[Any], goal: NDArray[Any]) -> Iterator[NDArray[np.uint8]]:
        """Pictures of one episode.

        Args:
            states: x, y, vx, vy [L, 4]. goal: x, y of its own goal [2].
        """
        self._model.site("target").pos[:] = (*goal, HEIGHT / 2)
        shown = [*range(0, len(states) - 1, EVERY), len(states) - 1]
        for number, step in enumerate(shown):
            self._data.qpos[:], self._data.qvel[:] = states[step, :2], states[step, 2:]
            mujoco.mj_forward(self._model, self._data)
            self._renderer.update_scene(self._data, self._camera)
            for place in states[shown[:number], :2]:
                self._mark(place)
            frame = self._renderer.render()
            yield from [frame] * (PAUSE if step == shown[-1] else 1)

    def close(self) -> None:
        """Free what OpenGL holds."""
        self._renderer.close()

    def _mark(self, place: NDArray[Any]) -> None:
        scene = self._renderer.scene
        where = np.array([*place, 0.02])
        sphere, colour = mujoco.mjtGeom.mjGEOM_SPHERE, np.array(TRAIL, dtype=np.float32)
        mujoco.mjv_initGeom(scene.geoms[scene.ngeom], sphere, TRAIL_SIZE, where, UPRIGHT, colour)
        scene.ngeom += 1


def film(source: Path, target: Path) -> None:
    """Write the first episodes of the last evaluation of a run.

    Args:
        source: its trajectories.npz. target: the mp4.
    """
    with np.load(source, allow_pickle=False) as data:
        maze = Maze("of the run", tuple(map(tuple, data["maze/walls"].astype(bool).tolist())))
        episodes = np.split(data["evaluation/states"], np.cumsum(data["evaluation/lengths"])[:-1])[:EPISODES]
        goals = data["evaluation/goals"]
    painter = Painter(maze)
    pairs = zip(episodes, goals, strict=False)
    write_video(target, (frame for states, goal in pairs for frame in painter.frames(states, goal)), FPS)
    painter.close()


def main(jobs: list[tuple[str, str]]) -> None:
    """Film every job, a pair of a trajectories.npz and an mp4."""
    with mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16) as renderer:
        renderer.render()
    print("READY", flush=True)
    for source, target in jobs:
        film(Path(source), Path(target))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))

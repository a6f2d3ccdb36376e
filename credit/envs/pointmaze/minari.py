"""Demonstrations that others recorded: PointMaze datasets in Minari's format."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path as File
from typing import Any

import numpy as np

from credit.core.errors import UserError
from credit.envs.pointmaze.controllers import Path
from credit.envs.pointmaze.demonstrations import UNKNOWN, Demonstrations
from credit.envs.pointmaze.task import RADIUS, Task

PARTS = {"observation": 4, "desired_goal": 2}


def read(source: str | File, task: Task, limit: int | None = None) -> Demonstrations:
    """Demonstrations for a task from a Minari dataset of PointMaze, whatever its own starts, goals and horizon.

    Args:
        source: a dataset's folder, or the name of one that Minari has on this machine (nothing is downloaded).
        task: the episodes are cut and labelled as in `trimmed`.
        limit: how many episodes to read, from the first; None reads all.

    Raises:
        UserError: Minari is not installed, no such dataset, or one that is not PointMaze's.
    """
    try:
        import minari
    except ImportError:
        raise UserError("to read a Minari dataset: pip install 'minari[hdf5]'") from None
    folder = File(source)
    try:
        if folder.exists():
            dataset = minari.MinariDataset(folder / "data" if (folder / "data").exists() else folder)
        else:
            dataset = minari.load_dataset(str(source))
    except (FileNotFoundError, ValueError) as error:
        raise UserError(
            f"demonstrations={source}: {error}; give a dataset's folder, or `minari download {source}`"
        ) from None
    return Demonstrations.of(*_labelled(islice(dataset.iterate_episodes(), limit), task, source))


def trimmed(observations: np.ndarray, goals: np.ndarray, actions: np.ndarray, task: Task) -> Path:
    """One episode as a trajectory of a task: cut behind the first arrival at the task's goal, and after H steps.

    The goal is the episode's own while that lies in the task's goal cell, else the middle of that cell.

    Args:
        observations: x, y, vx, vy [L + 1, 4]. goals: the episode's own [L + 1, 2]. actions: [L, 2].
    """
    nominal = np.array(task.maze.xy(task.goal))
    own = (np.abs(goals[1:] - nominal) < 0.5).all(-1, keepdims=True)
    distance = np.linalg.norm(observations[1:, :2] - np.where(own, goals[1:], nominal), axis=-1)
    reached = np.flatnonzero(distance[: task.horizon] <= RADIUS)
    steps = int(reached[0]) + 1 if len(reached) else min(len(actions), task.horizon)
    states, forces = observations[: steps + 1].astype(np.float32), actions[:steps].astype(np.float32)
    return Path(states, np.clip(forces, -1, 1), success=len(reached) > 0)


def _labelled(episodes: Iterable[Any], task: Task, source: str | File) -> tuple[list[Path], list[str]]:
    paths = []
    for episode in episodes:
        observed, steps = episode.observations, len(episode.actions)
        for part, width in PARTS.items():
            if not isinstance(observed, dict) or np.shape(observed.get(part, ())) != (steps + 1, width):
                raise UserError(
                    f"demonstrations={source}: episode {episode.id} with {steps} actions has no "
                    f"observations[{part!r}] of shape {(steps + 1, width)}; only datasets of PointMaze can be read"
                )
        if np.shape(episode.actions) != (steps, 2) or steps == 0:
            raise UserError(f"demonstrations={source}: episode {episode.id} has actions {np.shape(episode.actions)}")
        paths.append(trimmed(observed["observation"], observed["desired_goal"], episode.actions, task))
    return paths, [UNKNOWN] * len(paths)

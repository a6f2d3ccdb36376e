"""The trajectories that all methods start from (6.3): successes, partial ones and failures, with one label each."""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path as File

import numpy as np
import torch
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.core.windows import Episode
from credit.data.minari import episodes
from credit.envs.pointmaze.controllers import Controller, Path
from credit.envs.pointmaze.outside import require_track, shaped
from credit.envs.pointmaze.task import RADIUS, Task

SUCCESS, PARTIAL, FAILURE, UNKNOWN = KINDS = ("success", "partial", "failure", "unknown")
RECORDED = {"observation": 4, "desired_goal": 2}  # what Gymnasium-Robotics observes, and how many numbers each has
ATTEMPTS = 50  # trajectories that are driven for one that is kept


@dataclass(frozen=True)
class Demonstrations:
    """K trajectories of N steps in all, one behind the other.

    Attributes:
        states, next_states: x, y, vx, vy, float32 [N, 4]. actions: float32 [N, 2].
        terminated: whether a step arrives at the goal, bool [N].
        lengths: L_i, int64 [K]. labels: Y_i (27), float32 [K]. kinds: how each was made, one of KINDS, str [K].
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    next_states: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    lengths: NDArray[np.int64]
    labels: NDArray[np.float32]
    kinds: NDArray[np.str_]

    @classmethod
    def of(cls, paths: Sequence[Path], kinds: Iterable[str]) -> Demonstrations:
        """Line up trajectories; each is terminated on its last step if it is a success."""
        empty = np.zeros((1, 4), np.float32)
        ends = [np.arange(len(p.actions)) == (len(p.actions) - 1 if p.success else -1) for p in paths]
        return cls(
            states=np.concatenate([p.states[:-1] for p in paths] or [empty[:0]]),
            actions=np.concatenate([p.actions for p in paths] or [empty[:0, :2]]),
            next_states=np.concatenate([p.states[1:] for p in paths] or [empty[:0]]),
            terminated=np.concatenate([*ends, np.zeros(0, bool)]).astype(bool),
            lengths=np.array([len(p.actions) for p in paths], np.int64),
            labels=np.array([p.success for p in paths], np.float32),
            kinds=np.array(list(kinds), "U7"),
        )

    def __len__(self) -> int:
        """K."""
        return len(self.lengths)

    @property
    def one_sided(self) -> bool:
        """Whether all labels are equal, so that nothing tells good steps from bad ones."""
        return len(np.unique(self.labels)) < 2

    @property
    def digest(self) -> str:
        """SHA-256 over names, types, shapes and values of all fields."""
        state = hashlib.sha256()
        for field in fields(self):
            values = np.ascontiguousarray(getattr(self, field.name))
            values = values.astype(values.dtype.newbyteorder("<"))
            state.update(f"{field.name} {values.dtype.str} {values.shape};".encode())
            state.update(values.tobytes())
        return state.hexdigest()

    def episodes(self) -> list[Episode]:
        """Each trajectory."""
        lengths, last = self.lengths.tolist(), (np.cumsum(self.lengths) - 1).tolist()
        states, actions, arrivals = (
            torch.from_numpy(column).split(lengths) for column in (self.states, self.actions, self.next_states)
        )
        over = self.terminated[last].tolist()
        return [Episode(*parts) for parts in zip(states, actions, arrivals, over, strict=True)]

    def save(self, file: str | File) -> None:
        """Write a .npz file without pickled objects."""
        with open(file, "wb") as stream:
            np.savez(stream, allow_pickle=False, **{f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, file: str | File) -> Demonstrations:
        """Read what `save` wrote.

        Raises:
            UserError: no such file, or one with other contents.
        """
        names = [field.name for field in fields(cls)]
        try:
            with np.load(file, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in names}
        except FileNotFoundError:
            raise UserError(f"demonstrations {file}: there is no such file") from None
        except Exception as error:  # whatever a damaged archive makes its reader raise
            why = str(error) if zipfile.is_zipfile(file) else "it is no .npz archive"
            raise UserError(f"demonstrations {file} cannot be read ({why}); expected .npz with {names}") from None
        return cls(**shaped(file, arrays))


def make(
    task: Task,
    successes: int = 10,
    partials: int = 10,
    failures: int = 10,
    seed: int = 0,
    controller: Controller | None = None,
) -> Demonstrations:
    """Drive demonstrations; the j-th of a kind depends on the seed, its kind and j, not on how many there are.

    A success follows the way-points to the goal; a partial one follows 2 to P − 2 of the P way-points (2 to 8 of 10 in
    Medium) and goes on at random; a failure is random from the start. One that ends otherwise is driven again.

    Raises:
        UserError: no trajectory of the wanted kind in ATTEMPTS attempts.
    """
    moves = len(task.path) - 1
    most = max(moves - 2, 0)
    legs = {SUCCESS: (moves, moves), PARTIAL: (min(2, most), most), FAILURE: (0, 0)}
    paths: list[Path] = []
    kinds: list[str] = []
    for kind, count in ((SUCCESS, successes), (PARTIAL, partials), (FAILURE, failures)):
        paths += _driven(task, kind, legs[kind], count, seed, controller or Controller())
        kinds += [kind] * count
    return Demonstrations.of(paths, kinds)


def recorded(source: str | File, task: Task, limit: int | None = None) -> Demonstrations:
    """Those of a Minari dataset of PointMaze, cut and labelled as in `trimmed`, whatever its own starts and horizon.

    Args:
        source, limit: as in `credit.data.minari.episodes`. task: whose demonstrations they are to be.

    Raises:
        UserError: a dataset that cannot be read, or one that is not PointMaze's.
    """
    paths = []
    for number, observed, actions, *_ in episodes(source, limit):
        steps = len(actions)
        for part, width in RECORDED.items():
            if not isinstance(observed, dict) or np.shape(observed.get(part, ())) != (steps + 1, width):
                raise UserError(
                    f"demonstrations={source}: episode {number} with {steps} actions has no observations[{part!r}] of "
                    f"shape {(steps + 1, width)}; only datasets of PointMaze can be read"
                )
        if actions.shape != (steps, 2):
            raise UserError(f"demonstrations={source}: episode {number} has actions {actions.shape}, not {(steps, 2)}")
        require_track(f"demonstrations {source}: episode {number}", observed["observation"], actions, task.maze)
        sound = np.isfinite(observed["desired_goal"]).all(-1)
        if not sound.all():
            step = int((~sound).argmax())
            raise UserError(f"demonstrations {source}: episode {number}, step {step}: desired_goal is not finite")
        paths.append(trimmed(observed["observation"], observed["desired_goal"], actions, task))
    return Demonstrations.of(paths, [UNKNOWN] * len(paths))


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


driven = lru_cache(maxsize=64)(make)  # the check of a run drives them, the run learns from them, pictures show them


def describe(demonstrations: Demonstrations) -> str:
    """What reward models can learn from these labels."""
    count, successes = len(demonstrations), int(demonstrations.labels.sum())
    if count == 0:
        return "There are no demonstrations: reward models know nothing until trajectories have been collected."
    listing = f"{count} demonstrations, {successes} of them successful ({len(demonstrations.states)} steps)"
    if successes == 0:
        return (
            f"{listing}: all labels are 0, which a reward of 0 everywhere fits without error. Reward models cannot "
            "learn where the goal is; until exploration finds it, the policy follows bonuses and entropy alone."
        )
    if successes == count:
        return (
            f"{listing}: all labels are 1, which 1/L on every step fits. Reward models learn to share a success among "
            "its steps, but not which steps fail to lead to one; every place that was visited looks good."
        )
    return f"{listing}: reward models can learn what sets successful trajectories apart from the others."


def _driven(task: Task, kind: str, legs: tuple[int, int], count: int, seed: int, controller: Controller) -> list[Path]:
    key = zlib.crc32(f"demonstrations {kind}".encode())
    noise = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, j))) for j in range(count)]
    kept: dict[int, Path] = {}
    for _ in range(ATTEMPTS):
        pending = [j for j in range(count) if j not in kept]
        if not pending:
            return [kept[j] for j in range(count)]
        wanted = [int(noise[j].integers(legs[0], legs[1] + 1)) for j in pending]
        driven = controller.drive(task, wanted, [noise[j] for j in pending])
        kept |= {j: path for j, path in zip(pending, driven, strict=True) if path.success == (kind == SUCCESS)}
    what = "did not reach the goal" if kind == SUCCESS else "reached the goal by chance"
    raise UserError(
        f"demonstrations: {count - len(kept)} of {count} of kind {kind} {what} in {ATTEMPTS} attempts within "
        f"horizon={task.horizon}; ask for fewer, or change the horizon, the maze or its goal"
    )

"""Demonstrations from outside: whatever is wrong in them is told by file, episode and step, before a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.envs.pointmaze.demonstrations import Demonstrations, make
from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.outside import in_walls, require, require_track
from credit.envs.pointmaze.task import Task

Arrays = dict[str, NDArray[Any]]
FIRST, SECOND = 1, 2  # successes, then failures


@pytest.fixture(scope="module")
def corridor_demonstrations() -> tuple[Task, Demonstrations]:
    task = Task(Maze.of(["11111", "10001", "11111"]), (1, 1), (1, 3), 80)
    return task, make(task, FIRST, 0, SECOND)


def changed(demonstrations: Demonstrations, change: Callable[[Arrays], None]) -> Arrays:
    arrays = {field.name: getattr(demonstrations, field.name).copy() for field in fields(demonstrations)}
    change(arrays)
    return arrays


def setting(name: str, place: Any, value: Any) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[name][place] = value

    return change


def scaled(name: str, by: float = 1.0, add: float = 0.0) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[name] = arrays[name] * by + add

    return change


def moved(arrays: Arrays) -> None:
    for name in ("states", "next_states"):
        arrays[name][:, :2] += 100


def both(place: int, row: Any) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays["states"][place] = arrays["next_states"][place - 1] = row

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (setting("states", (3, 1), np.nan), r"episode 0, step 3: the state is \[.*nan"),
        (setting("actions", (-1, 0), np.inf), r"episode 2, step 79: the action is \[inf"),
        (scaled("actions", 100), r"episode 0, step 0: the action is .* are so\); pushes lie in \[-1, 1\]"),
        (moved, r"episode 0, step 0: a wall is where the ball is, .* free cell .* of another maze"),
        (both(5, 0.0), r"episode 0, step \d: the ball moves by .* at most 0\.1 m"),
        (setting("states", slice(5, 10), 0.0), r"episode 0, step 4: the ball moves by"),
        (setting("next_states", (5, 3), 0.5), r"episode 0, step 5: next_states is .* and the next step begins at"),
        (setting("states", (5, 2), 11.0), r"episode 0, step 5: the ball's speed is"),
        (setting("labels", 1, 2.0), r"episode 1: the label is 2 .* labels are 1 for"),
        (setting("labels", 1, -3.0), r"episode 1: the label is -3"),
        (setting("labels", 0, 0.0), r"episode 0: the label is 0 and terminated in steps \[\d+\]"),
        (setting("labels", 1, 1.0), r"episode 1: the label is 1 and terminated in steps \[\]"),
        (setting("terminated", 3, True), r"episode 0: the label is 1 and terminated in steps \[3, \d+\]"),
        (setting("lengths", 0, 3), r"states have the shape \(\d+, 4\), and 3 trajectories with \d+ steps"),
        (setting("lengths", 0, 0), r"lengths are \[0, 80, 80\]; they must be whole numbers, 1 or more"),
        (setting("lengths", 0, -1), "lengths are"),
        (scaled("lengths", 1.0), "they must be whole numbers"),
        (lambda arrays: arrays.update(actions=arrays["actions"][:, :1]), r"actions have the shape \(\d+, 1\)"),
        (lambda arrays: arrays.update(labels=np.array(["a"] * 3)), "labels are of type <U1"),
    ],
)
def test_what_is_wrong_is_told(
    corridor_demonstrations: tuple[Task, Demonstrations],
    tmp_path: Path,
    change: Callable[[Arrays], None],
    said: str,
) -> None:
    task, good = corridor_demonstrations
    np.savez(tmp_path / "mine.npz", allow_pickle=False, **changed(good, change))
    with pytest.raises(UserError, match=said) as caught:
        require(tmp_path / "mine.npz", Demonstrations.load(tmp_path / "mine.npz"), task)
    assert "mine.npz" in str(caught.value)


def test_what_was_driven_is_right(corridor_demonstrations: tuple[Task, Demonstrations], medium: Task) -> None:
    task, good = corridor_demonstrations
    require("none", good, task)
    require("none", make(medium, 2, 2, 2), medium)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_half_an_archive_is_named(
    corridor_demonstrations: tuple[Task, Demonstrations], tmp_path: Path, share: float
) -> None:
    file = tmp_path / "mine.npz"
    corridor_demonstrations[1].save(file)
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(UserError, match=r"demonstrations .*mine\.npz cannot be read"):
        Demonstrations.load(file)


def test_steps_of_another_maze_lie_in_walls(medium: Task) -> None:
    large = Task(Maze.of("Large"), (1, 1), (7, 10), 600)
    other = make(large, 1, 0, 0)
    track = np.concatenate([other.states, other.next_states[-1:]])
    assert not in_walls(track, large.maze).any()
    with pytest.raises(UserError, match=r"mine: episode 7, step \d+: a wall .* \(\d+ of \d+ are so\); .* maze Medium"):
        require_track("mine: episode 7", track, other.actions, medium.maze)

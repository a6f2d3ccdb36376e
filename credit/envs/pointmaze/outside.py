"""Is that a ball's way through a maze? What comes from outside is looked through, step by step, before a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.envs.pointmaze.maze import Maze
from credit.envs.pointmaze.task import TIMESTEP, TOP_SPEED, Task

if TYPE_CHECKING:
    from credit.envs.pointmaze.demonstrations import Demonstrations

FASTEST = 2 * TOP_SPEED  # m/s: what a push adds to the top speed, and other simulators, are well below
ROUNDING = 1e-5  # of an action at its bound
COLUMNS: dict[str, tuple[Any, ...]] = {  # name → type, and what a row of it has
    **{name: (np.float32, width) for name, width in (("states", 4), ("actions", 2), ("next_states", 4))},
    "terminated": (bool,),
    "lengths": (np.int64,),
    "labels": (np.float32,),
    "kinds": ("U",),
}


def require_track(
    where: str, states: NDArray[np.floating[Any]], actions: NDArray[np.floating[Any]], maze: Maze
) -> None:
    """Refuse what no ball does in a maze.

    Args:
        where: file and episode, for the message. states: x, y, vx, vy [L + 1, 4]. actions: [L, 2]. maze: the map.

    Raises:
        UserError: a number is not finite, a ball is in a wall, is too fast or jumps, an action is out of range; with
            the step and its value.
    """
    for wrong, values, what, allowed in _rules(states, actions, maze):
        if wrong.any():
            step, count = int(wrong.argmax()), int(wrong.sum())
            more = f" ({count} of {len(wrong)} are so)" if count > 1 else ""
            raise UserError(f"{where}, step {step}: {what} {values[step].tolist()}{more}; {allowed}")


def shaped(file: str | Path, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays of a file, in the types that `Demonstrations` has.

    Raises:
        UserError: their shapes do not go together.
    """
    lengths = arrays["lengths"]
    if lengths.ndim != 1 or lengths.dtype.kind not in "iu" or (lengths < 1).any():
        raise UserError(f"demonstrations {file}: lengths are {lengths.tolist()}; they must be whole numbers, 1 or more")
    rows, count, found = int(lengths.sum()), len(lengths), dict[str, NDArray[Any]]()
    for name, (kind, *tail) in COLUMNS.items():
        values, wanted = arrays[name], (count if name in ("lengths", "labels", "kinds") else rows, *tail)
        if values.shape != wanted:
            raise UserError(
                f"demonstrations {file}: {name} have the shape {values.shape}, and {count} trajectories with {rows} "
                f"steps in all (lengths) have {wanted}"
            )
        if (values.dtype.kind == "U") != (kind == "U"):
            raise UserError(f"demonstrations {file}: {name} are of type {values.dtype}")
        found[name] = values.astype(kind) if kind != "U" else values
    return found


def require(source: str | Path, found: Demonstrations, task: Task) -> None:
    """Refuse what no ball does in a task's maze, and labels that do not say whether it came to the goal.

    Args:
        source: the file, for the message. found: what it has. task: whose demonstrations they are to be.

    Raises:
        UserError: with the file, the episode, the step and its value.
    """
    ends = np.cumsum(found.lengths)
    for k, (first, end) in enumerate(zip(ends - found.lengths, ends, strict=True)):
        where, label = f"demonstrations {source}: episode {k}", float(found.labels[k])
        states, arrivals = found.states[first:end], found.next_states[first:end]
        require_track(where, np.concatenate([states, arrivals[-1:]]), found.actions[first:end], task.maze)
        apart = ~np.isclose(states[1:], arrivals[:-1]).all(-1)
        if apart.any():
            step = int(apart.argmax())
            raise UserError(
                f"{where}, step {step}: next_states is {arrivals[step].tolist()}, and the next step begins at "
                f"{states[step + 1].tolist()}"
            )
        over = found.terminated[first:end]
        if label not in (0, 1) or (over[:-1]).any() or bool(over[-1]) != bool(label):
            raise UserError(
                f"{where}: the label is {label:g} and terminated in steps {np.flatnonzero(over).tolist()} of "
                f"{len(over)}; labels are 1 for a trajectory whose last step, and no other, is terminated, else 0"
            )
        if len(over) > task.horizon:
            raise UserError(
                f"{where} has {len(over)} steps, and the horizon is {task.horizon}; it is of another task; give "
                "others, or a larger feedback.window"
            )


def in_walls(states: NDArray[np.floating[Any]], maze: Maze) -> NDArray[np.bool_]:
    """Which of states [n, 4] are in a wall, or outside [n]."""
    rows, columns = maze.grid.shape
    row = np.floor(rows / 2 - states[:, 1]).astype(np.int64)
    column = np.floor(states[:, 0] + columns / 2).astype(np.int64)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return ~inside | maze.grid[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


def _rules(
    states: NDArray[np.floating[Any]], actions: NDArray[np.floating[Any]], maze: Maze
) -> Iterator[tuple[NDArray[np.bool_], NDArray[Any], str, str]]:
    """What is wrong [n], of which values, what they are, and what is allowed; later rules need the earlier ones."""
    for name, values in (("state", states), ("action", actions)):
        yield ~np.isfinite(values).all(-1), values, f"the {name} is", "numbers must be finite"
    yield (np.abs(actions) > 1 + ROUNDING).any(-1), actions, "the action is", "pushes lie in [-1, 1]"
    other = f"it must be in a free cell of maze {maze.name}; these may be steps of another maze"
    yield in_walls(states, maze), states[:, :2], "a wall is where the ball is,", other
    limit = f"at most {FASTEST:g} m/s are possible"
    yield (np.abs(states[:, 2:]) > FASTEST).any(-1), states[:, 2:], "the ball's speed is", limit
    moved, most = np.diff(states[:, :2], axis=0), FASTEST * TIMESTEP
    yield (
        np.asarray((np.abs(moved) > most).any(-1)),
        moved,
        "the ball moves by",
        f"at most {most:g} m in a step are possible",
    )

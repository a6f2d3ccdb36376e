"""Steps of a file, of a run's folder or of a Minari dataset, as learners of an environment see them."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Environment
from credit.data import minari, tables
from credit.data.logged import Logged

STEPS = "steps.parquet"  # in a run's folder, of runs with keep=[steps]


def read(source: str | Path, env: Environment, problem: Problem) -> Logged:
    """The steps of a source, in the spaces of a problem.

    Args:
        source: a CSV or Parquet file (`credit.data.tables.read` says its columns), the folder of a run that kept its
            steps, or a Minari dataset on this machine, its folder or its name.
        env: what they are steps of. problem: its problem.

    Raises:
        UserError: the source cannot be read, or its steps are of other spaces; with what does not fit.

    Example:
        >>> read("log.csv", Gymnasium("CartPole-v1"), problem).rewards
    """
    path = Path(source)
    if path.suffix in tables.SUFFIXES:
        found = _of_table(path, env, problem)
    elif (path / STEPS).exists():
        found = _of_table(path / STEPS, env, problem)
    elif (path / "config.yaml").exists() or list(path.glob("seed-*/config.yaml")):
        found = _of_windows(path, env, problem)
    elif path.is_file():
        raise UserError(f"{path}: files of steps end in {' or '.join(tables.SUFFIXES)}")
    else:
        found = _of_minari(str(source), env, problem)
    found.require(problem)
    if (impossible := env.impossible(found.states) | env.impossible(found.next_states)).any():
        row, count = int(impossible.argmax()), int(impossible.sum())
        raise UserError(
            f"{source}: {found.where(row)} is where nobody can be in this environment, from "
            f"{found.states[row].tolist()} to {found.next_states[row].tolist()} ({count} of {len(found)} steps are so)"
            "; these may be steps of another one"
        )
    return found


def _of_table(file: Path, env: Environment, problem: Problem) -> Logged:
    columns = tables.read(file)
    count = len(columns["action"])
    episode = tables.numbered(columns.get("episode", np.zeros(count)))
    if (parts := np.unique(columns["episode"]).size if "episode" in columns else 1) <= int(episode.max(initial=0)):
        raise UserError(
            f"{file}: {parts} episodes in {int(episode[-1]) + 1} pieces; the rows of an episode follow each other: "
            "sort them by column episode"
        )
    labels, closes = columns.get("label"), None
    if labels is not None:
        stretches = tables.numbered(columns["window"]) if "window" in columns else None
        cut = ~np.isnan(labels) if stretches is None else np.diff(stretches, append=-1) != 0
        closes = cut | (np.diff(episode, append=-1) != 0)
        if (lost := ~np.isnan(labels) & ~closes).any():
            raise UserError(f"{file}: row {int(lost.argmax())} has a label, and is not the last row of its window")
    rewards = columns.get("reward")
    if rewards is not None and np.isnan(rewards).any():
        rewards = None  # there are labels instead
    step = _steps(file, episode, columns.get("step"))
    return Logged(
        str(file),
        _states(file, "observation", columns["observation"], problem),
        _actions(file, env, columns["action"], problem),
        _states(file, "next_observation", columns["next_observation"], problem),
        episode,
        step,
        columns.get("terminated", np.zeros(count)).astype(bool),
        rewards,
        columns["success"].astype(bool) if "success" in columns else None,
        labels,
        closes,
    )


def _of_windows(folder: Path, env: Environment, problem: Problem) -> Logged:
    """The windows that a run with a finite problem leaves in any case, where all have T steps: `recovery.npz`."""
    file, config = folder / "recovery.npz", folder / "config.yaml"
    whole = (
        config.exists() and yaml.safe_load(config.read_text(encoding="utf-8"))["trainer"].get("steps_per_round") is None
    )
    try:
        with np.load(file, allow_pickle=False) if whole and file.exists() else nullcontext({}) as arrays:
            found = {name: arrays.get(f"windows/{name}") for name in ("states", "actions", "next_states", "labels")}
    except Exception as error:  # whatever a damaged archive makes its reader raise
        raise UserError(f"{file} cannot be read ({error}); restore it, or compute the run again") from None
    if any(part is None for part in found.values()) or (found["states"] < 0).any():
        kept = ", ".join(str(file.parent) for file in sorted(folder.glob(f"*/{STEPS}"))[:3])
        hint = f"give one run of them: {kept}" if kept else "compute it again with keep=[steps] rerun=true"
        raise UserError(f"{folder}: no steps were kept in this folder ({STEPS}); {hint}")
    count, length = found["states"].shape
    closes = np.tile(np.arange(length) == length - 1, count)
    labels = np.full(count * length, np.nan)
    labels[closes] = found["labels"]
    episode = np.repeat(np.arange(count), length) if problem.episodic else np.zeros(count * length, np.int64)
    return Logged(
        str(file),
        _states(file, "observation", found["states"].ravel(), problem),
        _actions(file, env, found["actions"].ravel(), problem),
        _states(file, "next_observation", found["next_states"].ravel(), problem),
        episode,
        _steps(file, episode, None),
        np.zeros(count * length, bool),
        labels=labels,
        closes=closes,
    )


def _of_minari(source: str, env: Environment, problem: Problem) -> Logged:
    try:
        parts = list(minari.episodes(source))
    except UserError as error:
        missing = "" if Path(source).exists() else "; and there is no file and no run's folder of that name"
        raise UserError(f"{error}{missing}") from None
    if not parts:
        raise UserError(f"{source}: there are no episodes in it")
    states, actions, arrivals = list[NDArray[Any]](), list[NDArray[Any]](), list[NDArray[Any]]()
    for part in parts:
        where = f"{source}, episode {part.number}"
        try:
            seen = env.states_of(part.observations).cpu().numpy()
        except UserError as error:
            raise UserError(f"{where}: {error}") from None
        seen = _states(where, "observation", seen, problem)
        states.append(seen[:-1])
        arrivals.append(seen[1:])
        actions.append(_actions(where, env, part.actions, problem))
    lengths = [len(part.actions) for part in parts]
    last = [np.arange(length) == length - 1 for length in lengths]
    told = [part.success for part in parts if part.success is not None]
    return Logged(
        source,
        np.concatenate(states),
        np.concatenate(actions),
        np.concatenate(arrivals),
        np.repeat(np.arange(len(parts)), lengths),
        np.concatenate([np.arange(length) for length in lengths]),
        np.concatenate([end & part.terminated for end, part in zip(last, parts, strict=True)]),
        np.concatenate([part.rewards for part in parts]),
        np.concatenate(told) if len(told) == len(parts) else None,
    )


def _steps(file: Path, episode: NDArray[np.int64], given: NDArray[Any] | None) -> NDArray[np.int64]:
    """The step in the episode of every row [n]."""
    rows = np.arange(len(episode))
    first = np.concatenate([[True], np.diff(episode) != 0])[: len(episode)]
    counted = rows - np.maximum.accumulate(np.where(first, rows, 0))
    if given is None:
        return counted
    begun = given[np.maximum.accumulate(np.where(first, rows, 0))]
    if (wrong := (given != begun + counted) | (given < 0)).any():
        row = int(wrong.argmax())
        raise UserError(f"{file}: step of row {row} is {given[row]:g}; steps of an episode rise by one from row to row")
    return given.astype(np.int64)


def _column(source: str | Path, name: str, values: NDArray[Any], finite: bool, width: int) -> NDArray[Any]:
    """As a problem has it, int64 [n] or float32 [n, width]; what has another shape is told by `Logged.require`.

    Raises:
        UserError: a number that is to be whole is not.
    """
    if not finite:
        return (values.reshape(len(values), -1) if width == 1 else values).astype(np.float32)
    if (broken := values != np.round(values)).any():
        row = int(broken.reshape(len(values), -1).any(-1).argmax())
        raise UserError(f"{source}: {name} of row {row} is {values[row].tolist()}: it must be a whole number")
    return values.astype(np.int64)


def _states(source: str | Path, name: str, values: NDArray[Any], problem: Problem) -> NDArray[Any]:
    return _column(source, name, values, problem.finite_states, 0 if problem.finite_states else problem.observations)


def _actions(source: str | Path, env: Environment, values: NDArray[Any], problem: Problem) -> NDArray[Any]:
    try:
        found = env.actions_of(values).cpu().numpy()
    except UserError as error:
        raise UserError(f"{source}: {error}") from None
    return _column(source, "action", found, problem.finite_actions, 0 if problem.finite_actions else problem.actions)

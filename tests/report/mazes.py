"""Run folders of a maze, written as the trainer writes them, without training anything."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from credit.envs.pointmaze.maze import Maze

MAZE = Maze.of(["#####", "#..##", "##..#", "#####"])
START, GOAL = (1, 1), (2, 3)
WINDOW = {"_target_": "credit.envs.feedback.Terminal", "window": 300}
ENV = {"_target_": "credit.envs.pointmaze.environment.PointMaze", "maze": "Medium", "goal": [6, 6], "successes": 10}
TRAINER = {"_target_": "credit.trainer.Trainer", "steps": 18000, "windows_per_round": 5, "log_every": 5}
NAMES = {"delayed": "Delayed SAC", "reference": "DNN-SAC", "disagreement": "Disagreement-SAC"}
MODELS = ("dnn", "cells", "heuristic")
KINDS = ("success", "partial", "failure")


def rates(success: Sequence[float]) -> dict[str, float]:
    """What the success rates after each round come to, one at a time."""
    learned = lost = 0
    reached = False
    for rate in success:
        learned += reached
        lost += reached and rate < 0.6
        reached = reached or rate >= 0.9
    tail = success[-4:]
    return {"auc": sum(success) / len(success), "final": sum(tail) / len(tail), "learned": learned, "lost": lost}


def journal(
    maze: Maze = MAZE, start: tuple[int, int] = START, goal: tuple[int, int] = GOAL, seed: int = 0
) -> dict[str, Any]:
    """Arrays of trajectories.npz: straight lines between way-points with noise, some of which stop early."""
    rng = np.random.default_rng(seed)
    points = np.array([maze.xy(cell) for cell in maze.path(start, goal)])
    legs = np.arange(len(points))
    arrays: dict[str, Any] = {"maze/walls": maze.grid, "maze/start": np.array(start), "maze/goal": np.array(goal)}
    for part, count in (("demonstrations", 6), ("online", 10), ("evaluation", 4)):
        success = rng.uniform(size=count) < 0.6 if part != "demonstrations" else np.arange(count) < 2
        lengths = rng.integers(40, 60, size=count)
        states = []
        for length, reached in zip(lengths, success, strict=True):
            along = np.linspace(0, legs[-1] * (1 if reached else rng.uniform(0.3, 0.7)), length)
            place = np.stack([np.interp(along, legs, points[:, axis]) for axis in (0, 1)], axis=1)
            place += rng.normal(size=2) * 0.12
            states.append(np.concatenate([place, np.gradient(place, axis=0) / 0.01], axis=1))
        arrays |= {f"{part}/states": np.concatenate(states).astype(np.float32), f"{part}/lengths": lengths}
        arrays[f"{part}/labels"] = success.astype(np.float32)
    arrays["demonstrations/kinds"] = np.repeat(KINDS, 2)
    arrays["evaluation/goals"] = np.tile(points[-1], (4, 1))
    return arrays


def recovery(maze: Maze = MAZE, models: Sequence[str] = MODELS, rounds: int = 5, seed: int = 0) -> dict[str, Any]:
    """Arrays of recovery.npz: 4 x 4 points in each free cell, one block a refit."""
    rng = np.random.default_rng(seed)
    offsets = (np.arange(4) - 1.5) / 4
    points = [(x + dx, y + dy) for x, y in map(maze.xy, maze.free) for dy in offsets for dx in offsets]
    states = np.concatenate([np.array(points), np.zeros((len(points), 2))], axis=1)
    shape = (rounds, len(states))
    weights = rng.dirichlet(np.ones(len(models)), size=shape)
    arrays: dict[str, Any] = {"models": np.array(models), "rounds": 5 * np.arange(rounds)}
    arrays |= {"grid/states": states, "grid/actions": np.zeros((len(states), 2)), "best": weights.argmax(-1)}
    hill = -np.hypot(states[:, 0] - 1.5, states[:, 1] + 0.5)
    for index, model in enumerate(models):
        arrays[f"reward/{model}"] = hill * (index + 1) / 100 + rng.normal(size=shape) / 200
        arrays |= {f"weight/{model}": weights[..., index], f"mse/{model}": rng.uniform(size=shape)}
    arrays["reward/mixed"] = sum(arrays[f"reward/{model}"] * arrays[f"weight/{model}"] for model in models)
    arrays |= {f"disagreement/{model}": rng.uniform(size=shape) for model in models[1:]}
    return arrays | {"reward/plan": arrays["reward/mixed"]}


def write_maze_run(
    output: Path,
    method: str,
    seed: int,
    success: Sequence[float],
    *,
    averaged: Sequence[float] | None = None,
    slug: str = "default",
    tracks: dict[str, Any] | None = None,
    beliefs: dict[str, Any] | None = None,
    env: dict[str, Any] | None = None,
) -> Path:
    """Write one finished run whose policy has these success rates after each round of 5 trajectories.

    Args:
        output: the folder of all experiments. method, slug, seed: which run.
        success: one a round. averaged: of the averaged actor, the same by default. env: what of it is not as usual.
        tracks: trajectories.npz. beliefs: recovery.npz; neither by default.
    """
    folder = output / "pointmaze" / method / slug / f"seed-{seed}"
    folder.mkdir(parents=True)
    rows: list[dict[str, float]] = []
    for place in range(len(success) + 1):
        row: dict[str, float] = {"step": 1500 * place}
        for after, values in (("", success), ("_averaged", averaged or success)):
            row[f"eval/success{after}"] = values[place - 1] if place else 0.0
            if place:
                row |= {f"eval/{name}{after}": value for name, value in rates(values[:place]).items()}
        rows.append(row)
    pd.DataFrame(rows).to_csv(folder / "metrics.csv", index=False)
    final = {name: value for name, value in rows[-1].items() if name != "step"}
    summary: dict[str, Any] = {"experiment": "pointmaze", "method": method, "slug": slug, "seed": seed}
    summary |= {"status": "FINISHED", "config_hash": f"hash-{method}-{slug}", "git_commit": "abc", "metrics": final}
    summary["paper"] = {"name": NAMES.get(method, method)}
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    config = {"env": {**ENV, **(env or {})}, "feedback": WINDOW, "trainer": TRAINER}
    (folder / "config.yaml").write_text(json.dumps(config), encoding="utf-8")
    for name, arrays in (("trajectories", tracks), ("recovery", beliefs)):
        if arrays is not None:
            np.savez(folder / f"{name}.npz", **arrays)
    (folder / "DONE").write_text(summary["config_hash"], encoding="utf-8")
    return folder

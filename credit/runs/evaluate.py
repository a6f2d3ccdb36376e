"""What policies of finished runs are worth: exactly where the environment knows, else in episodes of their own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.policy import tabulate
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import PositiveInt
from credit.core.seams import Environment, Feedback
from credit.core.streams import generators, reset_seed
from credit.core.truth import ContinuingTruth
from credit.envs.episodes import Grid, World, play, ticks
from credit.judges.choose import objective_of
from credit.runs import job as jobs
from credit.runs.policies import POLICY, Kept, read

Changes = Mapping[str, Any]
INDEX = ["run", "seed", "episode"]


def evaluate(
    runs: str | Path | Sequence[str | Path],
    episodes: PositiveInt = 100,
    changes: Changes | None = None,
    *,
    policy: str = "behaviour",
    seed: int = 0,
) -> pd.DataFrame:
    """Judge the kept policies of runs, in their environment or in one with other parameters.

    Nobody learns, and nothing is written. Where the environment knows P and r, a policy is judged exactly; elsewhere it
    plays episodes with random numbers that no run has seen, the same ones for all runs of a seed.

    Args:
        runs: the folder of a run, or of all its seeds; or several.
        episodes: of each seed, where it plays.
        changes: parameters of the environment that differ, such as `{"env.p_down": 0.3}`.
        policy: which, where a run has several: `greedy` without bonus, `averaged`, …
        seed: of the random numbers.

    Returns:
        A row an episode, indexed by run, seed and episode: `return`, `label` (the mean label of its windows, as the
        run's feedback makes them), `length`, and `success` where the environment tells. Where it is exact, a row a
        seed: `return` and, where that is another thing, `label` are expectations, and `best` and `random` those of the
        best policy and of uniform actions; or, where the task goes on for ever, `reward` a step, and `best`.
        `frame.attrs["exact"]` says so.

    Raises:
        UserError: a folder without a policy, a parameter that the environment does not have, or other spaces.

    Example:
        >>> credit.evaluate("outputs/CartPole-v1/reference/default", 50)["return"].groupby("seed").mean()
    """
    if episodes < 1:
        raise UserError(f"episodes={episodes}: at least 1 is allowed")
    given = [runs] if isinstance(runs, (str, Path)) else runs
    places = [*dict.fromkeys(place for run in given for place in seeds_of(Path(run)))]
    contents = [read(place) for place in places]
    configs = [changed(content["config"], changes or {}) for content in contents]
    frames = list[pd.DataFrame]()
    for place, content, config in zip(places, contents, configs, strict=True):
        kept = Kept(content, place / POLICY, config)
        found = exactly(kept, policy)
        frame = pd.DataFrame(episodes_of(kept, policy, episodes, seed) if found is None else [found])
        frames.append(frame.assign(run=str(place.parent), seed=kept.seed, exact=found is not None))
    frame = pd.concat(frames, ignore_index=True)
    kinds = frame.pop("exact").unique()
    if len(kinds) > 1:
        raise UserError("some of these runs are judged exactly, and others play episodes: evaluate them apart")
    exact = bool(kinds[0])
    frame["episode"] = frame.groupby(INDEX[:2]).cumcount()
    frame = frame.set_index(INDEX[:2] if exact else INDEX)
    frame = frame.drop(columns="episode", errors="ignore").dropna(axis=1, how="all")
    frame.attrs["exact"] = exact
    return frame


def seeds_of(folder: Path) -> list[Path]:
    """The folders of the seeds of a run, in their order: itself, or those below it.

    Raises:
        UserError: there are none, or runs further below.
    """
    if (folder / "config.yaml").exists() or not folder.is_dir():
        return [folder]
    seeds = [place for place in folder.glob("seed-*") if (place / "config.yaml").exists()]
    if not seeds:
        below = sorted({str(file.parents[1]) for file in folder.rglob("seed-*/config.yaml")})
        where = f"; below it there are {', '.join(below[:5])}" if below else ""
        raise UserError(f"{folder}: no run lies here{where}; give the folder of a run, such as …/default/seed-0")
    return sorted(seeds, key=lambda place: (len(place.name), place.name))


def changed(config: Mapping[str, Any], changes: Changes) -> dict[str, Any]:
    """The configuration of a run with other parameters of its environment.

    Raises:
        UserError: with every one that is not the environment's, or has a value that it does not allow.
    """
    found, env = dict(config), {**config["env"]}
    for key, value in changes.items():
        first, _, name = key.partition(".")
        if first != "env" or not name:
            raise UserError(f"{key}={value}: only the environment can be another one here: env.KEY=VALUE")
        node, (*path, last) = env, name.split(".")
        for part in path:
            inner = node.get(part)
            node[part] = {**inner} if isinstance(inner, Mapping) else {}
            node = node[part]
        node[last] = value
    found["env"] = env
    if changes and (problems := [text for text in jobs.schema_of(found).problems if text.startswith("env")]):
        raise UserError("\n".join(problems))
    return found


def exactly(kept: Kept, name: str) -> dict[str, float] | None:
    """What a policy is worth, where the environment knows and the policy is a table or says its probabilities."""
    policy, env, problem = kept.named(name), kept.env, kept.problem
    if not problem.tabular:
        return None
    env.start(problem, purpose="evaluate")
    objective = objective_of(kept.feedback)
    truth = env.truth(objective, problem.horizon)
    table = None if truth is None else tabulate(policy, problem)
    if truth is None or table is None:
        return None
    if isinstance(truth, ContinuingTruth):
        if table.dim() > 2 and not torch.equal(table, table[:, :1].expand_as(table)):
            return None  # it looks at the step in a window
        table = table if table.dim() == 2 else table[:, 0]
        return {"reward": float(truth.evaluate(table)), "best": truth.gain}
    by_step = table if table.dim() > 2 else table.unsqueeze(1).expand(-1, problem.horizon, -1)
    value = {"label": float(truth.evaluate(by_step)), "best": truth.best, "random": truth.random}
    if objective == "sum":
        return {"return": value.pop("label"), **value}
    total = env.truth("sum", problem.horizon)
    known = {} if total is None or isinstance(total, ContinuingTruth) else {"return": float(total.evaluate(by_step))}
    return known | value


def episodes_of(kept: Kept, name: str, episodes: int, seed: int) -> Iterator[dict[str, Any]]:
    """Episodes of a policy, with random numbers that depend on the run's seed and on another one."""
    policy, problem, feedback = kept.named(name), kept.problem, kept.feedback
    purpose = f"evaluate {seed}"
    copies = min(episodes, kept.env.evaluation_episodes)
    env: Environment = kept.env.twin()
    env.start(problem, copies, purpose)
    world = World(env, ticks(problem, copies))
    feedback.start(replace(problem, seeds=(reset_seed(kept.seed, f"{purpose}, feedback", 0, 0),)))
    lengths = generators(problem.seeds, f"{purpose}, windows")[0]
    for done in range(0, episodes, copies):
        grid = play(world, policy, problem, reads=feedback.reads, facts=True)
        success, labels = _success(grid, feedback), labels_of(grid, feedback, problem, lengths)
        for k in range(min(copies, episodes - done)):
            yield {
                "return": float(grid.rewards[0, k].sum()),
                "label": labels[k],
                "length": int(grid.active[0, k].sum()),
                **({} if success is None else {"success": bool(success[k])}),
            }


def _success(grid: Grid, feedback: Feedback) -> Tensor | None:
    """Which episodes are a success [K], where there is such a thing."""
    if "success" in grid.facts:
        return grid.facts["success"][0]
    return (grid.rewards[0] > 0).any(-1) if objective_of(feedback) == "success" else None


def labels_of(grid: Grid, feedback: Feedback, problem: Problem, numbers: np.random.Generator) -> list[float]:
    """The mean label of each episode's windows, all of which arrive at once; NaN where it has none.

    Args:
        grid: episodes of one seed. feedback: started. numbers: of which lengths of windows are drawn.
    """
    least, most = feedback.lengths or (problem.window, problem.window)
    windows, whose = list[Tensor](), list[int]()
    for k, (rewards, active) in enumerate(zip(grid.seen[0], grid.active[0], strict=True)):
        rest = rewards[active]
        while len(rest):
            size = int(numbers.integers(least, most + 1))
            if len(rest) >= size or feedback.cut == "label":
                windows.append(rest[:size])
                whose.append(k)
            rest = rest[size:]
    block = torch.zeros(1, len(windows), most, dtype=FLOAT, device=grid.seen.device)
    for row, window in zip(block[0], windows, strict=True):
        row[: len(window)] = window
    length = torch.tensor([[len(window) for window in windows]], device=block.device)
    labels = feedback.label(block, length)[0].cpu().numpy() if windows else np.zeros(0)
    owners = np.array(whose)
    return [
        float(labels[owners == k].mean()) if (owners == k).any() else float("nan") for k in range(len(grid.seen[0]))
    ]

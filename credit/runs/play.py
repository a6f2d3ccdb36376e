"""Episodes of a kept policy, step by step, with pictures where the environment can be looked at."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from torch import Tensor

from credit.core.errors import UserError
from credit.core.policy import Policy
from credit.core.seams import Environment
from credit.envs.episodes import World, ticks
from credit.envs.episodes import play as roll
from credit.runs.evaluate import Changes, changed, seeds_of
from credit.runs.policies import POLICY, Kept, read

FPS = 30  # where an environment does not say it


@dataclass(frozen=True)
class Played:
    """Episodes of one seed.

    Attributes:
        steps: a frame with a row a step: `episode`, `step`, `state` as learners see it, `action` in the environment's
            own space, `reward`, and whether it is a `success`, where that is told.
        frames: pictures [height, width, 3] before each step and behind the last, where they were asked for. fps: how
            many a second.
        arrays: what a film of a maze needs: its walls, and where the ball went; empty elsewhere.
        source: the folder of the seed.
    """

    steps: pd.DataFrame
    frames: list[np.ndarray]
    fps: float
    arrays: dict[str, np.ndarray]
    source: Path


@dataclass
class Watched(Policy):
    """A policy, and pictures of what it acts on."""

    policy: Policy
    env: Environment
    frames: list[np.ndarray] = field(default_factory=list)

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """What the policy does."""
        self.look()
        return self.policy.act(states, step)

    def look(self) -> None:
        """One more picture."""
        self.frames.append(np.asarray(self.env.frame()))


def play(
    run: str | Path,
    episodes: int = 1,
    changes: Changes | None = None,
    *,
    policy: str = "behaviour",
    seed: int = 0,
    frames: bool = False,
) -> Played:
    """Let a run's kept policy act.

    Args:
        run: the folder of a seed; of several, the first.
        episodes: how many. changes, policy, seed: as in `evaluate`.
        frames: whether there are to be pictures, where the environment can be looked at.

    Raises:
        UserError: as `evaluate`.

    Example:
        >>> credit.play("outputs/CartPole-v1/reference/default/seed-0").steps["reward"].sum()
    """
    if episodes < 1:
        raise UserError(f"episodes={episodes}: at least 1 is allowed")
    place = seeds_of(Path(run))[0]
    content = read(place)
    kept = Kept(content, place / POLICY, changed(content["config"], changes or {}))
    acting, problem = kept.named(policy), kept.problem
    filmed = kept.env.filmed() if frames else None
    env = filmed or kept.env.twin()
    env.start(problem, 1, f"play {seed}")
    world, watched = World(env, ticks(problem, 1)), Watched(acting, env)
    parts, goals = list[pd.DataFrame](), list[np.ndarray]()
    for episode in range(episodes):
        grid = roll(world, watched if filmed else acting, problem, facts=True)
        if filmed:
            watched.look()
        goals.append(grid.facts["goals"][0, 0].cpu().numpy() if "goals" in grid.facts else np.zeros(0))
        count = int(grid.active.sum())
        columns: dict[str, Any] = {
            "episode": [episode] * count,
            "step": range(count),
            "state": _listed(grid.states[0, 0, :count]),
            "action": _listed(env.recorded(grid.actions[0, 0, :count])),
            "reward": grid.rewards[0, 0, :count].tolist(),
        }
        if "success" in grid.facts:
            columns["success"] = [False] * (count - 1) + [bool(grid.facts["success"][0, 0])]
        parts.append(pd.DataFrame(columns))
    steps = pd.concat(parts, ignore_index=True)
    return Played(steps, watched.frames, _fps(env), _maze(env, steps, goals), place)


def _listed(values: Tensor) -> list[Any]:
    """A number a step, or an array."""
    return values.tolist() if values.dim() == 1 else list(values.cpu().numpy())


def _fps(env: Environment) -> float:
    one = getattr(env, "_one", None)
    return float((getattr(one, "metadata", None) or {}).get("render_fps") or FPS)


def _maze(env: Environment, steps: pd.DataFrame, goals: list[np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of `trajectories.npz` that a film is made of."""
    seen = env.picture(0)
    if "maze/walls" not in seen:
        return {}
    return {
        "maze/walls": seen["maze/walls"],
        "evaluation/states": np.stack(list(steps["state"])),
        "evaluation/lengths": steps.groupby("episode").size().to_numpy(),
        "evaluation/goals": np.stack(goals),
    }

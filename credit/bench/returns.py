"""`credit bench returns`: are agents on true rewards as good as Stable-Baselines3's with the same settings?"""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import credit
from credit.bench.measure import Row
from credit.core.errors import UserError
from credit.report.statistics import paired_difference
from credit.runs.composing import compose
from credit.runs.intervals import mean_interval

SEEDS = range(1000, 1005)
EPISODES = 20  # of the final policy


@dataclass(frozen=True)
class Task:
    """An environment, and how long it is learned.

    Attributes:
        id: of Gymnasium. steps: of each seed. words: further overrides.
    """

    id: str
    steps: int
    words: tuple[str, ...] = ()

    @property
    def overrides(self) -> list[str]:
        """What is typed."""
        last = ("env.evaluation_episodes=20", "trainer.log_every=100000", "feedback=episode_sum", "method=oracle")
        return ["env=gymnasium", f"env.id={self.id}", f"trainer.steps={self.steps}", *last, *self.words]


TASKS = (
    Task("Pendulum-v1", 20_000),
    Task("InvertedDoublePendulum-v5", 50_000),
    Task("CartPole-v1", 50_000, ("agent.double=false", "agent.loss=smooth_l1")),  # as theirs is
    Task("HalfCheetah-v5", 100_000),
)


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Five seeds of each, side by side here and one after the other there; hours, on one thread.

    Raises:
        UserError: Stable-Baselines3 is not installed.
    """
    if importlib.util.find_spec("stable_baselines3") is None:
        raise UserError("credit bench returns: Stable-Baselines3 is not installed; pip install 'credit-rl[bench]'")
    torch.set_num_threads(1)
    rows = []
    for task in TASKS:
        say(f"{task.id}, {task.steps} steps, {len(SEEDS)} seeds")
        ours, theirs = credits(task), peers(task, say)
        rows += [
            Row(f"{task.id}: return after {task.steps:,} steps", interval(ours)),
            Row(f"{task.id}: Stable-Baselines3's", interval(theirs)),
            compared(task, ours, theirs),
        ]
        for row in rows[-3:]:
            say(f"{row.what}: {row.figure}")
    return rows


def compared(task: Task, ours: np.ndarray, theirs: np.ndarray) -> Row:
    """The difference, by seed; as good where its interval is not below zero."""
    found = paired_difference(ours, theirs)
    figure = f"{found.value:.1f} [{found.low:.1f}, {found.high:.1f}]"
    return Row(f"{task.id}: ours − theirs, paired by seed", figure, "not below 0", not found.high < 0)


def interval(returns: np.ndarray) -> str:
    """Mean with its 95% interval."""
    mean, low, high = mean_interval(returns)
    return f"{mean:.1f} [{low:.1f}, {high:.1f}]"


def credits(task: Task) -> np.ndarray:
    """The final return of each seed, here."""
    with tempfile.TemporaryDirectory() as folder:
        words = [f"seed={SEEDS[0]}", f"replicas={len(SEEDS)}", "tracking=none", f"output={folder}"]
        result = credit.run([*task.overrides, *words], threads=1)
    if result.error:
        raise RuntimeError(f"{task.id}: {result.error}")
    return result.metrics["eval/return"]


def peers(task: Task, say: Callable[[str], None]) -> np.ndarray:
    """The final return of each seed, there."""
    import gymnasium
    from stable_baselines3.common.evaluation import evaluate_policy

    found = []
    for seed in SEEDS:
        say(f"{task.id}: Stable-Baselines3, seed {seed}")
        model = peer(compose(task.overrides), gymnasium.make(task.id), seed)
        model.learn(task.steps)
        env = gymnasium.make(task.id)
        env.reset(seed=seed)
        mean, _ = evaluate_policy(model, env, n_eval_episodes=EPISODES, deterministic=True, warn=False)
        found.append(float(mean))
    return np.array(found)


def peer(config: Mapping[str, Any], env: Any, seed: int) -> Any:
    """Stable-Baselines3's agent with our settings."""
    from stable_baselines3 import DQN, SAC

    agent, trainer = config["agent"], config["trainer"]
    shared = {
        "learning_rate": agent["learning_rate"],
        "batch_size": agent["batch"],
        "gamma": agent["discount"],
        "learning_starts": trainer["random_steps"],
        "seed": seed,
        "device": "cpu",
    }
    if agent["_target_"].endswith("DQN"):
        every = trainer["steps_per_round"]
        return DQN(
            "MlpPolicy",
            env,
            **shared,
            buffer_size=agent["capacity"],
            train_freq=every,
            gradient_steps=round(agent["update_ratio"] * every),
            # theirs counts steps, ours gradient steps
            target_update_interval=round(agent["target_sync"] / agent["update_ratio"]),
            exploration_fraction=agent["epsilon_steps"] / trainer["steps"],
            exploration_initial_eps=agent["epsilon"],
            exploration_final_eps=agent["epsilon_floor"],
            max_grad_norm=agent["gradient_clip"] or float("inf"),
            policy_kwargs={"net_arch": list(agent["hidden"])},
        )
    return SAC(
        "MlpPolicy",
        env,
        **shared,
        buffer_size=trainer["steps"],
        tau=agent["target_rate"],
        train_freq=1,
        gradient_steps=round(agent["update_ratio"]),
        policy_kwargs={"net_arch": [agent["width"]] * agent["depth"]},
    )

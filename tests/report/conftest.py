"""Synthetic run folders, written as the trainer writes them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from credit.config.files import conf_dir

NAMES = {
    "block": "Block-UCB",
    "delayed": "Delayed Q-learning",
    "reference": "Ridge-UCB",
    "adaptive_mse": "Adaptive MSE-UCB",
    "disagreement": "Disagreement-UCB",
}
ENV = yaml.safe_load((conf_dir() / "env" / "advertiser.yaml").read_text(encoding="utf-8"))
TRAINER = {"_target_": "credit.trainer.Trainer", "steps": 14000, "windows_per_round": 1, "log_every": 40}
BLOCK_SUM = {"_target_": "credit.envs.feedback.BlockSum", "window": 7, "noise": 0.2}
TERMINAL = {"_target_": "credit.envs.feedback.Terminal", "window": 5}
WriteRun = Callable[..., Path]


def recovery_arrays(rng: np.random.Generator, states: int = 4, actions: int = 3) -> dict[str, Any]:
    """What a learner believes at the end, with arrays [S, A]."""
    truth = rng.normal(size=(states, actions))
    weight = rng.uniform(size=(states, actions))
    arrays: dict[str, Any] = {
        "models": np.array(["ridge", "linear"]),
        "reward/true": truth,
        "reward/mixed": truth + 0.1,
    }
    arrays |= {"reward/ridge": truth + 0.2, "reward/linear": truth - 0.3}
    return arrays | {"weight/ridge": weight, "weight/linear": 1 - weight}


@pytest.fixture
def write_run(tmp_path: Path) -> WriteRun:
    """Writes one run folder below tmp_path/outputs and returns it."""

    def write(
        method: str,
        seed: int,
        metrics: Mapping[str, float | None],
        *,
        experiment: str = "advertiser",
        slug: str = "default",
        config_hash: str | None = None,
        mixer: Mapping[str, Any] | None = None,
        steps: tuple[int, ...] = (100, 200, 300),
        recovery: Mapping[str, Any] | None = None,
        done: bool = True,
        feedback: Mapping[str, Any] = BLOCK_SUM,
        env: Mapping[str, Any] = ENV,
        trainer: Mapping[str, Any] = TRAINER,
        commit: str | None = "abc123",
        version: str | None = "0.1.0",
    ) -> Path:
        folder = tmp_path / "outputs" / experiment / method / slug / f"seed-{seed}"
        folder.mkdir(parents=True)
        final = {name: np.nan if value is None else value for name, value in metrics.items()}
        rows = [{name: value * step / steps[-1] for name, value in final.items()} for step in steps]
        curve = pd.DataFrame(rows)
        curve.insert(0, "step", steps)
        curve.to_csv(folder / "metrics.csv", index=False)
        summary = {
            "experiment": experiment,
            "method": method,
            "slug": slug,
            "seed": seed,
            "status": "FINISHED",
            "config_hash": config_hash or f"hash-of-{method}-{slug}",
            "git_commit": commit,
            "versions": {"credit": version, "torch": "2.0"} if version else {"torch": "2.0"},
            "metrics": dict(metrics),
            "paper": {"name": NAMES.get(method, method)},
        }
        config = {"env": env, "feedback": feedback, "trainer": trainer} | ({"mixer": mixer} if mixer else {})
        (folder / "config.yaml").write_text(json.dumps(config), encoding="utf-8")
        (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
        if recovery is not None:
            np.savez(folder / "recovery.npz", **recovery)
        if done:
            (folder / "DONE").write_text(summary["config_hash"], encoding="utf-8")
        return folder

    return write

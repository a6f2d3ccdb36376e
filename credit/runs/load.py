"""Open a finished run again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from credit.core.errors import UserError
from credit.renamed import translated


@dataclass(frozen=True)
class Run:
    """One run: configuration, journal (a frame indexed by step), summary, and arrays where there are any."""

    folder: Path
    config: dict[str, Any]
    metrics: pd.DataFrame
    summary: dict[str, Any]
    recovery: dict[str, np.ndarray] | None
    trajectories: dict[str, np.ndarray] | None = None


def load(run_dir: str | Path) -> Run:
    """Load a run from its folder alone.

    Raises:
        UserError: the folder holds no finished run.

    Example:
        >>> run = credit.load("outputs/advertiser/disagreement/default/seed-0")
        >>> run.metrics["regret/cumulative"].iloc[-1], run.recovery["reward/mixed"].shape
    """
    folder = Path(run_dir)
    if not (folder / "DONE").exists():
        raise UserError(f"{folder}: no finished run lies here (no file DONE); give a folder like …/default/seed-0")
    return Run(
        folder,
        translated(yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))),
        pd.read_csv(folder / "metrics.csv", index_col="step"),
        json.loads((folder / "summary.json").read_text(encoding="utf-8")),
        _arrays(folder / "recovery.npz"),
        _arrays(folder / "trajectories.npz"),
    )


def _arrays(file: Path) -> dict[str, np.ndarray] | None:
    if not file.exists():
        return None
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)

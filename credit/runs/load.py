"""Open a finished run again."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import yaml

from credit.core.errors import UserError
from credit.renamed import translated
from credit.runs.headlines import HEADLINES
from credit.runs.rows import JOURNAL, STEP, read_rows, require_columns, unusable

if TYPE_CHECKING:
    from credit.runs.policies import KeptPolicy

LONG = 30  # letters of a name in a line


@dataclass(frozen=True, repr=False)
class Run:
    """One run: configuration, journal (a frame indexed by step), summary, and arrays where there are any."""

    folder: Path
    config: dict[str, Any]
    metrics: pd.DataFrame
    summary: dict[str, Any]
    recovery: dict[str, np.ndarray] | None
    trajectories: dict[str, np.ndarray] | None = None

    @cached_property
    def policy(self) -> KeptPolicy:
        """What the run's policy does: `run.policy(observation)`, an action in the environment's own space.

        Raises:
            UserError: the run kept none, and why.

        Example:
            >>> run = credit.load("outputs/advertiser/disagreement/default/seed-0")
            >>> run.policy(3)
            1
        """
        from credit.runs.policies import POLICY, Kept, KeptPolicy, read

        return KeptPolicy(Kept(read(self.folder), self.folder / POLICY))

    def __repr__(self) -> str:
        """The run in a line: which, how long, and what it came to."""
        last = ", ".join(f"{name}={value:.4g}" for name, value in self._headlines().items())
        *named, seed = self.folder.resolve().parts[-4:]
        place = "/".join([*(name if len(name) <= LONG else f"{name[:LONG]}…" for name in named), seed])
        return f"Run({place}: {self.metrics.index.max()} steps{last and f', {last}'})"

    def _headlines(self) -> dict[str, float]:
        """Its first two final metrics that are known."""
        found = {name: value for name, value in self.summary.get("metrics", {}).items() if value is not None}
        shown = [name for name in HEADLINES if name in found]
        return {name: found[name] for name in shown[:2]}


def load(run_dir: str | Path) -> Run:
    """Load a run from its folder alone.

    Raises:
        UserError: the folder holds no finished run, or one of its files is damaged.

    Example:
        >>> run = credit.load("outputs/advertiser/disagreement/default/seed-0")
        >>> run.metrics["regret/cumulative"].iloc[-1], run.recovery["reward/mixed"].shape
    """
    folder = Path(run_dir)
    if not (folder / "DONE").exists():
        raise UserError(f"{folder}: no finished run lies here (no file DONE); give a folder like …/default/seed-0")
    summary = _read(folder, "summary.json", lambda file: json.loads(file.read_text(encoding="utf-8")))

    def journal(file: Path) -> pd.DataFrame:
        rows = read_rows(file.parent)
        require_columns(rows.columns, summary["metrics"])
        return rows.astype({STEP: int}).set_index(STEP)

    return Run(
        folder,
        _read(folder, "config.yaml", _config),
        _read(folder, JOURNAL, journal),
        summary,
        _read(folder, "recovery.npz", _arrays),
        _read(folder, "trajectories.npz", _arrays),
    )


def _read(folder: Path, name: str, read: Callable[[Path], Any]) -> Any:
    """A file, or what is wrong with it."""
    try:
        return read(folder / name)
    except (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise UserError(unusable(folder, name, error)) from error
    except (yaml.YAMLError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(unusable(folder, name, error)) from error


def _config(file: Path) -> dict[str, Any]:
    return translated(yaml.safe_load(file.read_text(encoding="utf-8")))


def _arrays(file: Path) -> dict[str, np.ndarray] | None:
    if not file.exists():
        return None
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)

"""Find and load the finished runs of an experiment from their folders."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from credit.errors import UserError, nearest

# The paper's methods in the order of its Table 1.
PAPER_METHODS = ("block", "delayed", "reference", "adaptive_mse", "disagreement")
IDENTITY = ("method", "slug", "seed", "name", "folder", "config_hash", "git_commit")


@dataclass(frozen=True)
class Runs:
    """The runs of one experiment.

    Attributes:
        experiment: its name.
        frame: one row a finished run: method, slug, seed, name (as displayed), folder, config_hash,
            git_commit, then one column a final metric (NaN = not known).
        unfinished: folders without DONE among those asked for; they are never used.
    """

    experiment: str
    frame: pd.DataFrame
    unfinished: tuple[Path, ...]

    @property
    def metrics(self) -> list[str]:
        """Names of the final metrics that at least one run knows."""
        names = [column for column in self.frame.columns if column not in IDENTITY]
        return [name for name in names if self.frame[name].notna().any()]


def load_runs(
    output: Path,
    experiment: str,
    *,
    methods: Sequence[str] | None = None,
    slugs: Sequence[str] | None = None,
    seed: int | None = None,
    replicas: int | None = None,
) -> Runs:
    """Load the final metrics of every finished run that was asked for.

    Args:
        output: the folder that holds all experiments.
        experiment: which one.
        methods: only these; all by default.
        slugs: only these variants ("default", or the slug of a run's overrides); all by default.
        seed: the first seed; seeds below it are left out.
        replicas: how many seeds from `seed` (or 0) on; all by default.

    Returns:
        The runs, sorted by method, slug and seed.

    Raises:
        UserError: nothing finished was found, a method that was asked for has no finished run, or runs of one
            method and slug come from different configurations.
    """
    first = seed or 0
    last = first + replicas if replicas is not None else None
    rows: list[dict[str, Any]] = []
    unfinished: list[Path] = []
    for folder in sorted((output / experiment).glob("*/*/seed-*")):
        suffix = folder.name.removeprefix("seed-")
        if not suffix.isdecimal():
            continue
        number = int(suffix)
        if (
            (methods and folder.parent.parent.name not in methods)
            or (slugs and folder.parent.name not in slugs)
            or number < first
            or (last is not None and number >= last)
        ):
            continue
        if (folder / "DONE").exists():
            rows.append(_read_summary(folder))
        else:
            unfinished.append(folder)
    finished = {done.parents[2].name for done in (output / experiment).glob("*/*/seed-*/DONE")}
    if finished:
        _require(methods, finished, experiment)
    if not rows:
        raise UserError(_nothing_found(output, experiment, finished, unfinished))
    frame = pd.DataFrame(rows).sort_values(["method", "slug", "seed"], ignore_index=True)
    _require(methods, set(frame["method"]), experiment)
    _check_same_configuration(frame)
    return Runs(experiment, frame, tuple(unfinished))


def load_curves(runs: pd.DataFrame, metric: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The curves of one metric for the runs of one method.

    Args:
        runs: rows of `Runs.frame` that belong together.
        metric: a column of metrics.csv.

    Returns:
        Steps [L] (primitive environment steps) and values [n, L], or None where a run lacks the metric. Runs
        that were logged at different steps are interpolated onto one grid, which ends with the shortest run.
    """
    curves: list[pd.DataFrame] = []
    for folder in runs["folder"]:
        curve = pd.read_csv(Path(folder) / "metrics.csv", usecols=lambda name: name in ("step", metric))
        if metric not in curve or curve[metric].isna().all():
            return None
        curves.append(curve.dropna())
    steps = [curve["step"].to_numpy(dtype=float) for curve in curves]
    values = [curve[metric].to_numpy(dtype=float) for curve in curves]
    if all(np.array_equal(steps[0], other) for other in steps):
        return steps[0], np.stack(values)
    grid = np.linspace(max(s[0] for s in steps), min(s[-1] for s in steps), max(len(s) for s in steps))
    return grid, np.stack([np.interp(grid, s, v) for s, v in zip(steps, values, strict=True)])


def describe_seeds(seeds: Sequence[int]) -> str:
    """Seeds as a range with their number, such as `0–19 (20)`."""
    span = str(min(seeds)) if len(seeds) == 1 else f"{min(seeds)}–{max(seeds)}"
    return f"{span} ({len(seeds)})"


def _read_summary(folder: Path) -> dict[str, Any]:
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return _row(summary, folder)
    except (OSError, ValueError, KeyError) as error:
        raise UserError(
            f"{folder} is marked as finished, but its summary.json cannot be used "
            f"({type(error).__name__}: {error}). Delete the folder and run this seed again."
        ) from error


def _row(summary: dict[str, Any], folder: Path) -> dict[str, Any]:
    metrics = {name: np.nan if value is None else float(value) for name, value in summary["metrics"].items()}
    return {
        "method": summary["method"],
        "slug": summary["slug"],
        "seed": int(summary["seed"]),
        "name": summary.get("paper", {}).get("name", summary["method"]),
        "folder": str(folder),
        "config_hash": summary["config_hash"],
        "git_commit": summary.get("git_commit"),
        **metrics,
    }


def _check_same_configuration(frame: pd.DataFrame) -> None:
    problems = []
    for (method, slug), group in frame.groupby(["method", "slug"]):
        by_hash = {str(key): list(part["seed"]) for key, part in group.groupby("config_hash")}
        if len(by_hash) > 1:
            parts = ", ".join(f"{key[:12]} (seeds {describe_seeds(seeds)})" for key, seeds in by_hash.items())
            problems.append(f"{method}/{slug}: {parts}")
    if problems:
        raise UserError(
            "Runs of different configurations cannot be averaged: " + "; ".join(problems) + ". "
            "Choose one of them by its seeds (seed=... replicas=...), or delete the outdated folders."
        )


def _require(methods: Sequence[str] | None, known: set[str], experiment: str) -> None:
    missing = sorted(set(methods or ()) - known)
    if missing:
        hints = "; ".join(f"method={name}: {nearest(name, known)}" for name in missing)
        raise UserError(
            f"No finished run of experiment={experiment} that was asked for has {hints}. "
            f"Run `credit train experiment={experiment} method={missing[0]}` first, or leave it out."
        )


def _nothing_found(output: Path, experiment: str, finished: set[str], unfinished: Sequence[Path]) -> str:
    others = sorted({folder.parents[2].name for folder in output.glob("*/*/*/seed-*")} - {experiment})
    if unfinished:
        names = sorted({folder.parent.parent.name for folder in unfinished})
        found = f"Found {len(unfinished)} unfinished run(s) of {', '.join(names)}."
    elif finished:
        found = f"Finished runs exist for {', '.join(sorted(finished))}, but not with these seeds and slugs."
    elif others:
        found = f"Found runs of {', '.join(others)} only."
    else:
        found = "Found no runs at all."
    return (
        f"No finished runs to compare for experiment={experiment} in {output}. {found} "
        f"Run `credit train -m experiment={experiment} method={','.join(PAPER_METHODS)} replicas=20` first."
    )

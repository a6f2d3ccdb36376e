"""Find and load the finished runs of an experiment from their folders."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.report.missing import Asked, nothing_found, require_methods
from credit.report.provenance import COLUMNS as CODE
from credit.report.provenance import choose_commits
from credit.report.reading import read_run, setting_of_unfinished, whole_name
from credit.report.settings import Setting, choose_settings, has
from credit.report.variants import choose_variants, variant
from credit.runs.rows import JOURNAL, read_rows, require_columns, unusable

IDENTITY = ("method", "slug", "seed", "name", "folder", "typed", "setting", "config_hash", *CODE)


@dataclass(frozen=True)
class Runs:
    """The runs of one experiment, or of one setting of it.

    Attributes:
        experiment: its name.
        frame: one row a finished run: method, slug (without what makes the setting), seed, name (as displayed),
            folder, typed (all its overrides), setting (as text), config_hash, git_commit, version, then one column a
            final metric (NaN = not known).
        unfinished: folders without DONE among those asked for; they are never used.
        setting: which, beside the others; without a name for the only one where nothing calls for a name.
    """

    experiment: str
    frame: pd.DataFrame
    unfinished: tuple[Path, ...]
    setting: Setting = field(default_factory=Setting)

    @property
    def window(self) -> int | None:
        """Steps of a whole window, where the feedback names them; of the first setting where there are several."""
        found = json.loads(self.frame["setting"].iloc[0]).get("feedback.window")
        return None if found is None else int(found)

    @property
    def metrics(self) -> list[str]:
        """Names of the final metrics that at least one run knows."""
        names = [column for column in self.frame.columns if column not in IDENTITY]
        return [name for name in names if self.frame[name].notna().any()]

    def by_setting(self, feedback: Sequence[str] | None = None, where: Mapping[str, Any] | None = None) -> list[Runs]:
        """The runs of each setting, ordered by its name.

        Args:
            feedback: only settings of these names; all by default.
            where: only settings with these values, such as `{"env.maze": "Large"}`.

        Raises:
            UserError: no run has a setting of that name, or with these values.
        """
        every = [str(text) for text in self.frame["setting"].unique()]
        chosen = choose_settings(every, self.experiment, feedback, where)
        overridden = bool((self.frame["typed"] != self.frame["slug"]).any())
        if len(every) == 1 and not feedback and not where and not overridden:
            return [self]
        # What has no finished run beside it, or no readable configuration, is still left out, and counted once.
        first = next(iter(chosen))
        labels = [(folder, setting_of_unfinished(folder)) for folder in self.unfinished]
        return [
            replace(
                self,
                frame=self.frame[self.frame["setting"] == text].reset_index(drop=True),
                unfinished=tuple(f for f, label in labels if (label if label in every else first) == text),
                setting=setting,
            )
            for text, setting in chosen.items()
        ]


def load_runs(
    output: Path,
    experiment: str,
    *,
    methods: Sequence[str] | None = None,
    slugs: Sequence[str] | None = None,
    seed: int | None = None,
    replicas: int | None = None,
    commits: Sequence[str] | None = None,
    where: Mapping[str, Any] | None = None,
) -> Runs:
    """Load the final metrics of every finished run that was asked for.

    Args:
        output: the folder that holds all experiments.
        experiment: which one.
        methods: only these; all by default.
        slugs: only these variants ("default", or the slug of a run's overrides, with or without those of the
            setting), as `credit.report.variants.choose_variants` reads them; all by default.
        seed: the first seed; seeds below it are left out.
        replicas: how many seeds from `seed` (or 0) on; all by default.
        commits: only runs that were made by these commits, by their first digits; all by default.
        where: values of the settings that will be looked at (`by_setting` chooses them): of others, runs that are
            damaged are left out.

    Returns:
        The runs, sorted by method, slug and seed.

    Raises:
        UserError: nothing finished was found, a method, variant or commit that was asked for has no finished run, or
            runs of one setting, method and slug come from different configurations; or a run is damaged.
    """
    first = seed or 0
    last = first + replicas if replicas is not None else None
    rows: list[dict[str, Any]] = []
    unfinished: list[Path] = []
    settings: dict[str, str] = {}
    every = sorted((output / experiment).glob("*/*/seed-*"))
    wanted = set[str]()
    typed = {parent: whole_name(parent) for parent in {folder.parent for folder in every}}
    names = {parent: {parent.name, name, variant(name)} for parent, name in typed.items()}
    if slugs and every:
        asked_of = [parent for parent in names if not methods or parent.parent.name in methods]
        wanted = choose_variants(slugs, set[str]().union(*(names[parent] for parent in asked_of)), experiment)
    for folder in every:
        suffix = folder.name.removeprefix("seed-")
        if not suffix.isdecimal():
            continue
        number = int(suffix)
        if (
            (methods and folder.parent.parent.name not in methods)
            or (slugs and not names[folder.parent] & wanted)
            or number < first
            or (last is not None and number >= last)
        ):
            continue
        if (folder / "DONE").exists():
            try:
                rows.append(read_run(folder, settings, typed[folder.parent]))
            except UserError:
                setting = setting_of_unfinished(folder)
                if not setting or has(setting, where or {}):
                    raise
        else:
            unfinished.append(folder)
    asked = Asked(output, experiment, methods, seed, replicas)
    finished = [done.parent for done in (output / experiment).glob("*/*/seed-*/DONE")]
    if finished:
        require_methods(asked, {folder.parents[1].name for folder in finished})
    if not rows:
        raise nothing_found(asked, finished, unfinished)
    frame = pd.DataFrame(rows).sort_values(["method", "slug", "seed"], ignore_index=True)
    if commits:
        frame = choose_commits(frame, commits, experiment)
    require_methods(asked, set(frame["method"]))
    _check_same_configuration(frame)
    # an override that repeats the default is another folder, but the same run
    frame = frame.drop_duplicates(["setting", "method", "slug", "seed"], ignore_index=True)
    return Runs(experiment, frame, tuple(unfinished))


def load_curves(runs: pd.DataFrame, metric: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The curves of one metric for the runs of one method.

    Args:
        runs: rows of `Runs.frame` that belong together.
        metric: a column of metrics.csv.

    Returns:
        Steps [L] (primitive environment steps) and values [n, L], or None where a run lacks the metric. Runs
        that were logged at different steps are interpolated onto one grid, which ends with the shortest run.

    Raises:
        UserError: a journal is damaged.
    """
    curves: list[pd.DataFrame] = []
    known = runs[metric] if metric in runs else [None] * len(runs)
    for folder, value in zip(map(Path, runs["folder"]), known, strict=True):
        try:
            curve = read_rows(folder, [metric])
            require_columns(curve.columns, {metric: value})
            if metric not in curve or curve[metric].isna().all():
                return None
            curves.append(curve.dropna(subset=["step", metric]))
        except (OSError, ValueError, KeyError) as error:
            raise UserError(unusable(folder, JOURNAL, error)) from error
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


def _check_same_configuration(frame: pd.DataFrame) -> None:
    problems = []
    for (_, method, slug), group in frame.groupby(["setting", "method", "slug"]):
        by_hash = {str(key): list(part["seed"]) for key, part in group.groupby("config_hash")}
        if len(by_hash) > 1 and _differ(group.drop_duplicates("config_hash")["folder"]):
            parts = ", ".join(f"{key[:12]} (seeds {describe_seeds(seeds)})" for key, seeds in by_hash.items())
            problems.append(f"{method}/{slug}: {parts}")
    if problems:
        raise UserError(
            "Runs of different configurations cannot be averaged: " + "; ".join(problems) + ". "
            "Choose one of them by its seeds (seed=… replicas=…) or commit (commit=…), or move the outdated folders "
            "to another output."
        )


def _differ(folders: Iterable[str]) -> bool:
    """Whether runs whose summaries have different hashes are different by today's identity, too."""
    from credit.runs import job  # it takes PyTorch, which a comparison needs for nothing else

    return len({job.identity(job.read(Path(folder))) for folder in folders}) > 1

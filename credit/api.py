"""What the commands do, from Python: each returns what it found, and raises `UserError` where a command would exit."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from credit.core.errors import UserError, nearest

if TYPE_CHECKING:
    from credit.cli.tuned import Tuned
    from credit.logged.result import LoggedCredit
    from credit.report.compare import Report

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def check(overrides: Sequence[str] = (), *, config_dirs: Sequence[str] = ()) -> pd.DataFrame:
    """The configuration of a job, as `credit check --explain` has it: each value, and where it comes from.

    Args:
        overrides: as on the command line. config_dirs: further folders of YAML files.

    Returns:
        Indexed by key: `value` and `origin`.

    Raises:
        UserError: with every problem found.

    Example:
        >>> credit.check(["method=disagreement"]).loc["mixer.alpha"]
    """
    from credit.config.origins import explained
    from credit.runs.composing import compose

    config = compose(overrides, config_dirs=config_dirs)
    rows = explained(config, [*overrides], [*config_dirs])
    return pd.DataFrame(rows, columns=["key", "value", "origin"]).set_index("key")


def list(kind: str | None = None, *, config_dirs: Sequence[str] = ()) -> pd.DataFrame:
    """What can be chosen, as `credit list` has it.

    Args:
        kind: such as `bonus`; None for the kinds themselves. config_dirs: further folders of YAML files.

    Returns:
        Indexed by name: `what` it is, and its `parameters` with their defaults; of kinds, their `options`.

    Raises:
        UserError: there is no such kind.

    Example:
        >>> credit.list("bonus").index.tolist()
    """
    from credit.cli.list import kinds, parameters, require_kind
    from credit.config import files
    from credit.config.kinds import KINDS
    from credit.config.registry import require_words

    require_words((), config_dirs)
    if kind is None:
        rows = {name: (line, [*files.options(name, config_dirs)]) for name, line in kinds().items()}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["what", "options"]).rename_axis("kind")
    require_kind(kind)
    found = {
        name: (files.describe_file(path), parameters(kind, path, config_dirs) if kind in KINDS else [])
        for name, path in files.options(kind, config_dirs).items()
    }
    return pd.DataFrame.from_dict(found, orient="index", columns=["what", "parameters"]).rename_axis(kind)


def compare(experiment: str = "advertiser", output: str | Path = "outputs", **choices: Any) -> Report:
    """Tables, intervals and figures from finished runs, as `credit compare` writes them.

    Args:
        experiment: whose runs. output: the folder that holds all experiments.
        choices: as `credit.report.compare.compare` has them: methods, slugs, feedback, where, commits, seed, replicas,
            reference, metric, …

    Returns:
        The report: `table` (a frame), `folder` and `files`.

    Raises:
        UserError: there is nothing to compare, or no such choice.

    Example:
        >>> credit.compare("advertiser", methods=["reference", "disagreement"], replicas=20).table
    """
    from credit.report.compare import compare as report

    known = [*inspect.signature(report).parameters][2:]
    if wrong := next((name for name in choices if name not in known), None):
        raise UserError(f"compare has no choice {wrong!r}; {nearest(wrong, known)}")
    return report(Path(output), experiment, **choices)


def recover(data: Any, **choices: Any) -> LoggedCredit:
    """A reward for every row of a table, from labels on windows of rows, with intervals, as `credit recover` finds it.

    Args:
        data: a pandas frame; a CSV or Parquet file, a folder, a pattern; the folder of a finished run; or a Minari
            dataset (`minari:NAME`, or its folder). choices: as `credit.logged.recover.recover` has them: reference,
            surrogates, mixer, what the columns are (window, label, states, actions, …), and how (draws, seed, …).

    Returns:
        Frames `steps`, `windows`, `effects`, `told`, and what is to be said of them.

    Raises:
        UserError: with what is wrong with the table or the words.

    Example:
        >>> found = credit.recover("outputs/advertiser/disagreement/default/seed-0", draws=50)
        >>> found.steps[["credit", "credit_low", "credit_high", "credit_balanced"]]
    """
    from dataclasses import fields

    from credit.cli.recovery_data import resolved
    from credit.logged.recover import recover as recovered
    from credit.logged.tables.words import Words

    roles = {one.name for one in fields(Words)}
    data, words = resolved(data, {name: value for name, value in choices.items() if name in roles})
    return recovered(data, **{name: value for name, value in choices.items() if name not in roles}, **words)


def sweep(overrides: Sequence[str], *, config_dirs: Sequence[str] = (), quiet: bool = True) -> pd.DataFrame:
    """Run many jobs on all cores, as `credit train -m` does; those that are done are not run again.

    Args:
        overrides: as on the command line: `["method=reference,disagreement", "replicas=5"]`, or `["sweep=table1"]`.
        config_dirs: further folders of YAML files. quiet: whether nothing is said of jobs that end.

    Returns:
        A row a run, indexed by job and seed: `method`, `overrides` (the words in which jobs differ), `status`,
        `folder`, and its final metrics.

    Raises:
        UserError: with the problems of all jobs; nothing was made.
        KeyboardInterrupt: after Ctrl-C; finished runs are kept, and the same call goes on with the others.

    Example:
        >>> runs = credit.sweep(["method=reference,disagreement", "replicas=5"])
        >>> runs.groupby("method")["regret/cumulative"].mean()
    """
    from rich.console import Console

    from credit.cli import train
    from credit.cli.common import Words
    from credit.config.registry import require_words

    require_words(overrides, config_dirs)
    words = Words([*overrides], ["-m"], [*config_dirs])
    jobs = train.checked_jobs(words, multirun=True)
    dirs = [f"--config-dir={folder}" for folder in config_dirs]
    with unchanged(THREADS):
        argv = ["train", "-m", *dirs, *overrides]
        train.computed(words, jobs, argv, Console(stderr=True, highlight=False, quiet=quiet), True, told=False)
    shared = set.intersection(*(set(typed) for _, typed in jobs))
    rows = [row for number, job in enumerate(jobs) for row in _rows(number, *job, shared)]
    return pd.DataFrame(rows).set_index(["job", "seed"])


def tune(overrides: Sequence[str], *, config_dirs: Sequence[str] = (), quiet: bool = True, **choices: Any) -> Tuned:
    """Search for the best setting on some seeds, and compare it with the default on others, as `credit tune` does.

    Args:
        overrides: as on the command line, some with an interval or several values: `["mixer.alpha=interval(.1,1)"]`.
        config_dirs: further folders of YAML files. quiet: whether nothing is said of trials that end.
        choices: trials, metric, sampler, at_once, timeout, report_seed, report_replicas, study.

    Returns:
        What was found: `best` (the words of the best setting), `trials` (a row a trial), `comparison` and `folder`.

    Raises:
        UserError: with what is wrong; or the study is one of something else.
        KeyboardInterrupt: after Ctrl-C; the same call goes on with it.

    Example:
        >>> credit.tune(["method=disagreement", "mixer.alpha=interval(.1,1)", "replicas=5"], trials=20).best
    """
    from rich.console import Console

    from credit.cli.common import Words
    from credit.cli.tune import Options, prepared
    from credit.config.registry import require_words

    known = [*inspect.signature(Options).parameters]
    if wrong := next((name for name in choices if name not in known), None):
        raise UserError(f"tune has no choice {wrong!r}; {nearest(wrong, known)}")
    require_words(overrides, config_dirs)
    search = prepared(Words([*overrides], [], [*config_dirs]), Options(**choices))
    argv = ["tune", *(f"--config-dir={folder}" for folder in config_dirs), *overrides]
    with unchanged(THREADS):
        return search.run(argv, Console(stderr=True, highlight=False, quiet=quiet))


def _rows(number: int, config: dict[str, Any], typed: Sequence[str], shared: set[str]) -> Iterator[dict[str, Any]]:
    """A row a seed of a job."""
    from credit.runs.job import Job

    job = Job.of(config)
    for seed in job.seeds:
        folder = job.parent / f"seed-{seed}"
        file = folder / "summary.json"
        summary = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        yield {
            "job": number,
            "seed": seed,
            "method": job.method,
            "overrides": " ".join(word for word in typed if word not in shared),
            "status": "FINISHED" if (folder / "DONE").exists() else summary.get("status", "NOT RUN"),
            "folder": folder,
            **{name: float("nan") if value is None else value for name, value in summary.get("metrics", {}).items()},
        }


@contextmanager
def unchanged(names: Sequence[str]) -> Iterator[None]:
    """Leave variables of the environment as they were."""
    before = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

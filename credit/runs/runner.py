"""Run one job: check, skip what is done, compute the rest side by side, and leave complete run folders."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from credit.config import schema
from credit.runs import folders
from credit.runs import job as jobs
from credit.runs.composing import compose
from credit.runs.journal import read_json
from credit.runs.session import JobRecord, Session
from credit.runs.threads import limited
from credit.runs.work import Progress, Work


@dataclass(frozen=True)
class Result:
    """How a job ended.

    Attributes:
        title: the method's name in tables. folders: one a seed, those that were done before included.
        computed: seeds that were computed now. resumed: those of them that had been interrupted. skipped: seeds that
            were done before.
        status: FINISHED or FAILED. seconds: wall time. error: why it failed.
        metrics: name → final values of all seeds, in the order of the folders; of those that finished.
    """

    title: str
    folders: list[Path]
    computed: list[int]
    resumed: list[int]
    skipped: list[int]
    status: str
    seconds: float
    metrics: dict[str, np.ndarray]
    error: str | None = None


def run(
    overrides: Sequence[str] = (),
    *,
    config_dirs: Sequence[str] = (),
    progress: Progress | None = None,
    threads: int | None = None,
    signals: bool = False,
) -> Result:
    """Run one job from Python, as `credit train` does with `threads=1, signals=True`.

    Args:
        overrides: as on the command line: `["method=reference", "replicas=5"]`.
        config_dirs: further folders of YAML files.
        progress: called with (title, steps done, steps in all).
        threads: how many the run computes on; None leaves PyTorch's as they are. To the bit, a run is the same only on
            as many.
        signals: whether SIGINT and SIGTERM end the run behind its round, with a checkpoint. Without, the process hears
            them as before: Ctrl-C ends it in the middle of a round, and the last checkpoint may be a minute old.

    Raises:
        UserError: the configuration or `threads` is wrong; nothing was made.
        KeyboardInterrupt: after Ctrl-C, or a signal that was heard; what was reached is kept.

    Example:
        >>> credit.run(["experiment=advertiser", "method=reference", "replicas=5"]).metrics["regret/cumulative"]
    """
    config = compose(overrides, config_dirs=config_dirs)
    job = jobs.Job.of(config)
    place(config)  # refuses a folder of another configuration before anything is made
    plan = [jobs.plan(config)]
    with limited(threads):
        session = Session.begin(
            job.folder, "job", job.experiment, ["train", *overrides], config["tracking"], plan, config_dirs
        )
        tracking = schema.build(config, "tracking")
        tracking.start(session.folder, job.folder)
        status = "KILLED"
        try:
            result = run_job(config, list(overrides), session, 0, progress, signals=signals)
            status = result.status
        finally:
            session.finish(status)
            tracking.finish()
    return result


def place(config: Mapping[str, Any]) -> Path:
    """The folder of a job's runs, looked through before anything is made.

    Raises:
        UserError: a folder in it holds a run of another configuration, or a checkpoint that cannot be read.
    """
    parent = jobs.Job.of(config).parent
    folders.find(config, parent)
    return parent


def run_job(
    config: Mapping[str, Any],
    overrides: Sequence[str],
    session: Session,
    number: int,
    progress: Progress | None = None,
    parent: Path | None = None,
    *,
    signals: bool = False,
) -> Result:
    """Compute the seeds of a checked job that are not done yet, and go on with those that were interrupted.

    A failure becomes the result's status and error, its traceback goes to `job-<number>.log` in the session's folder.

    Args:
        config: checked. overrides: as they were typed. session, number: whose job it is. progress: as in `run`.
        parent: the folder of its runs, where that is not what its names make.
        signals: as in `run`.

    Raises:
        UserError: the parts refuse their sizes, or a folder holds another run; no run was touched.
        KeyboardInterrupt: after a signal, with checkpoints written and journals closed with status KILLED.
    """
    job = jobs.Job.of(config)
    begun, computed, resumed = time.monotonic(), list[int](), list[int]()
    status, error = "FINISHED", None
    with folders.claimed(config, parent or job.parent) as found:
        for group in found.groups:
            work = Work(config, overrides, session, number, found, group)
            status, error = work.compute(progress, signals)
            computed += group.wanted
            resumed += group.wanted if group.interrupted else ()
            if status != "FINISHED":
                break
        if not found.groups:
            JobRecord.settle(session, number)
    places = [found.of(seed) for seed in sorted({*found.asked, *found.wanted})]
    took = time.monotonic() - begun
    return Result(job.title, places, computed, resumed, list(found.done), status, took, _final_metrics(places), error)


def _final_metrics(folders: Sequence[Path]) -> dict[str, np.ndarray]:
    """Metric → one value a finished run; NaN where it is not known."""
    finished = [folder for folder in folders if (folder / "DONE").exists()]
    last = [read_json(folder / "summary.json")["metrics"] for folder in finished]
    names = dict.fromkeys(name for metrics in last for name in metrics)
    return {name: np.array([metrics.get(name) for metrics in last], dtype=float) for name in names}

"""Run one job: check, skip what is done, compute the rest side by side, and leave complete run folders."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from credit import job as jobs
from credit import registry, schema
from credit.artifacts import Recorder, write_arrays
from credit.session import JobRecord, Session
from credit.tracking.journal import Journal, git_commit, versions, write_atomically, write_json, write_yaml
from credit.trainer import Trainer

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Result:
    """How a job ended.

    Attributes:
        title: the method's name in tables. folders: one a seed, those that were done before included.
        computed: seeds that were computed now. skipped: seeds that were done before.
        status: FINISHED or FAILED. seconds: wall time. error: why it failed.
        metrics: name → final values of all seeds, in the order of the folders; of those that finished.
    """

    title: str
    folders: list[Path]
    computed: list[int]
    skipped: list[int]
    status: str
    seconds: float
    metrics: dict[str, np.ndarray]
    error: str | None = None


def compose(overrides: Sequence[str] = (), *, config_dirs: Sequence[str] = ()) -> dict[str, Any]:
    """The resolved and checked configuration of one job, without what it does not use.

    Args:
        overrides: as on the command line. config_dirs: further folders of YAML files.

    Raises:
        UserError: with every problem found.
    """
    return jobs.checked(registry.compose(overrides, config_dirs))


def run(overrides: Sequence[str] = (), *, config_dirs: Sequence[str] = (), progress: Progress | None = None) -> Result:
    """Run one job from Python, as `credit train` does.

    Args:
        overrides: as on the command line: `["method=reference", "replicas=5"]`.
        config_dirs: further folders of YAML files.
        progress: called with (title, steps done, steps in all).

    Raises:
        UserError: the configuration is wrong; nothing was made.

    Example:
        >>> credit.run(["experiment=advertiser", "method=reference", "replicas=5"]).metrics["regret/cumulative"]
    """
    config = compose(overrides, config_dirs=config_dirs)
    job = jobs.Job.of(config)
    place(config, list(overrides))  # refuses a folder of another configuration before anything is made
    plan = [jobs.plan(config, list(overrides))]
    session = Session.begin(
        job.folder, "job", job.experiment, ["train", *overrides], config["tracking"], plan, config_dirs
    )
    tracking = schema.build(config, "tracking")
    tracking.start(session.folder, job.folder)
    status = "KILLED"
    try:
        result = run_job(config, list(overrides), session, 0, progress)
        status = result.status
    finally:
        session.finish(status)
        tracking.finish()
    return result


def place(config: Mapping[str, Any], overrides: Sequence[str]) -> tuple[Path, list[int], list[int]]:
    """The folder of a job's runs, the seeds to compute and the seeds that are done.

    Raises:
        UserError: a folder holds a run of another configuration.
    """
    job = jobs.Job.of(config)
    parent = job.folder / job.experiment / job.method / registry.slug(overrides)
    return parent, *jobs.split(config, parent)


def run_job(
    config: Mapping[str, Any],
    overrides: Sequence[str],
    session: Session,
    number: int,
    progress: Progress | None = None,
) -> Result:
    """Compute the seeds of a checked job that are not done yet.

    A failure becomes the result's status and error, its traceback goes to `job-<number>.log` in the session's folder.

    Raises:
        UserError: the parts refuse their sizes, or a folder holds another run; no run was touched.
        KeyboardInterrupt: after the journals were closed with status KILLED.
    """
    torch.set_num_threads(1)
    job = jobs.Job.of(config)
    parent, todo, done = place(config, overrides)
    folders = [parent / f"seed-{seed}" for seed in job.seeds]
    if not todo:
        return Result(job.title, folders, [], done, "FINISHED", 0.0, _final_metrics(folders))
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start(tuple(todo), jobs.device(job.device, number))
    recorder = Recorder(trainer)
    fresh = [parent / f"seed-{seed}" for seed in todo]
    started, cpu = time.time(), time.process_time()
    journal = Journal(fresh, started)  # before the record: whoever follows it must find no older journal
    record = JobRecord(session, number, started, _facts(config, overrides, parent, todo, fresh, trainer))
    for seed, folder in zip(todo, fresh, strict=True):
        write_yaml(folder / "config.yaml", {**config, "seed": seed, "replicas": 1, "rerun": False})
    status, error = "KILLED", None
    try:
        news = job.title

        def note(step: int, values: dict[str, torch.Tensor]) -> None:
            nonlocal news
            journal.log(step, {name: column.tolist() for name, column in values.items()})
            recorder.note(step)
            if "eval/success" in values:
                news = f"{job.title}, round {trainer.rounds}, success {float(values['eval/success'].mean()):.2f}"

        trainer.run(note, lambda steps: progress(news, steps, trainer.steps) if progress else None)
        for index, folder in enumerate(fresh):
            for name, arrays in recorder.files(index).items():
                write_arrays(folder / name, arrays)
        status = "FINISHED"
    except Exception as failure:  # a component may raise anything; the job says so, and a sweep goes on
        status, error = "FAILED", f"{type(failure).__name__}: {failure}"
        with (session.folder / f"job-{number}.log").open("a", encoding="utf-8") as log:
            log.write(f"job {number} ({job.method}, seeds {todo[0]}–{todo[-1]})\n{traceback.format_exc()}\n")
    finally:
        journal.flush()
        summary = _summary(config, record, status, time.process_time() - cpu)
        for seed, folder, last in zip(todo, fresh, journal.last, strict=True):
            data = {name: digests[str(seed)] for name, digests in record.facts["data"].items()}
            write_json(folder / "summary.json", summary | {"seed": seed, "metrics": last, "data": data})
            if status == "FINISHED":
                write_atomically(folder / "DONE", summary["config_hash"] + "\n")
        record.finish(status, error)
    return Result(job.title, folders, todo, done, status, time.time() - started, _final_metrics(folders), error)


def _facts(
    config: Mapping[str, Any],
    overrides: Sequence[str],
    parent: Path,
    seeds: list[int],
    folders: list[Path],
    trainer: Trainer,
) -> dict[str, Any]:
    job = jobs.Job.of(config)
    return {
        "experiment": job.experiment,
        "method": job.method,
        "title": job.title,
        "slug": parent.name,
        "env": config["env"]["_target_"].rpartition(".")[2],
        "seeds": seeds,
        "folders": [str(folder.relative_to(job.folder)) for folder in folders],
        "config_hash": jobs.identity(config),
        "config": dict(config),
        "overrides": list(overrides),
        "data": {
            name: dict(zip(map(str, seeds), digests, strict=True)) for name, digests in trainer.env.digests().items()
        },
    }


def _summary(config: Mapping[str, Any], record: JobRecord, status: str, cpu_seconds: float) -> dict[str, Any]:
    """What is common to the runs of a job; CPU seconds are the job's, divided evenly."""
    facts, now = record.facts, time.time()
    share = 1 / len(facts["seeds"])
    kept = {key: facts[key] for key in ("experiment", "method", "slug", "session", "config_hash")}
    return kept | {
        "status": status,
        "job": facts["id"],
        "started": facts["started"],
        "finished": now,
        "wall_seconds": now - facts["started"],
        "cpu_seconds": cpu_seconds * share,
        "git_commit": git_commit(),
        "versions": versions(),
        "paper": {"name": config["title"]},
    }


def _final_metrics(folders: Sequence[Path]) -> dict[str, np.ndarray]:
    """Metric → one value a finished run; NaN where it is not known."""
    finished = [folder for folder in folders if (folder / "DONE").exists()]
    last = [json.loads((folder / "summary.json").read_text(encoding="utf-8"))["metrics"] for folder in finished]
    names = dict.fromkeys(name for metrics in last for name in metrics)
    return {name: np.array([metrics.get(name) for metrics in last], dtype=float) for name in names}

"""What lies in an output folder: its sessions and how far they are, its runs by job; read from outside, light."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from credit.core.errors import UserError
from credit.runs.headlines import HEADLINES
from credit.runs.locks import Lock

DONE, SUMMARY = "DONE", "summary.json"


@dataclass(frozen=True)
class Progress:
    """A job that runs.

    Attributes:
        title: of its method. steps, total: done, and in all. left: seconds to its end at its pace; None: unknown yet.
    """

    title: str
    steps: int
    total: int
    left: float | None


@dataclass(frozen=True)
class Session:
    """One `credit train`.

    Attributes:
        id: which. command: as it was typed. status: running, done, failed, stopped, or killed: begun, never ended, and
            nobody works on it.
        started: epoch seconds. seconds: how long it took, or takes already; None where its end is not known.
        jobs: how many, as far as is known: a search begins them by and by.
        ended: status → how many of them ended so. running: those that run.
    """

    id: str
    command: str
    status: str
    started: float
    seconds: float | None
    jobs: int
    ended: dict[str, int]
    running: tuple[Progress, ...]


STATUS = {"FINISHED": "done", "FAILED": "failed", "KILLED": "stopped"}


def sessions(output: Path) -> Iterator[Session]:
    """The sessions of an output folder, newest first; what cannot be read is left out."""
    for file in sorted(output.glob("sessions/*/session.json"), reverse=True):
        with suppress(OSError, ValueError, LookupError, TypeError):
            yield _session(file.parent, json.loads(file.read_text(encoding="utf-8")))


def _session(folder: Path, facts: dict[str, Any]) -> Session:
    alive = Lock(folder / ".lock").held_elsewhere()
    status = "running" if alive else STATUS.get(facts["status"], "killed")
    ended = dict[str, int]()
    for record in _records(folder, "job-*.json"):
        if (word := STATUS.get(record["status"])) is not None:
            ended[word] = ended.get(word, 0) + 1
    posts = _records(folder / "now", "job-*.json") if alive else ()
    running = tuple(progress_of(post) for post in posts if post["state"] == "running")
    end = time.time() if alive else facts["finished"]
    seconds = None if end is None else max(end - facts["started"], 0.0)
    return Session(facts["id"], facts["command"], status, facts["started"], seconds, len(facts["plan"]), ended, running)


def _records(folder: Path, pattern: str) -> Iterator[dict[str, Any]]:
    for file in sorted(folder.glob(pattern)):
        with suppress(OSError, ValueError):  # just being replaced
            yield json.loads(file.read_text(encoding="utf-8"))


def progress_of(post: dict[str, Any]) -> Progress:
    """How far a job is that has posted so."""
    now = time.time()
    steps, total, since = post["steps"], post["total"], post.get("since")
    first, begun = (since["steps"], since["time"]) if since else (0, now)
    pace = (steps - first) / (now - begun) if now > begun else 0.0
    return Progress(post["title"], steps, total, (total - steps) / pace if pace > 0 and total else None)


@dataclass(frozen=True)
class Runs:
    """The runs of one job, a folder each seed.

    Attributes:
        folder: what they lie in: experiment, method, variant. done, unfinished: folders of seeds.
        busy: whether somebody computes one of them now. bytes: on the disk. written: when last, epoch seconds.
        metric, value: the first known of the main metrics, and its mean over the seeds that are done.
    """

    folder: Path
    done: tuple[Path, ...]
    unfinished: tuple[Path, ...]
    busy: bool
    bytes: int
    written: float
    metric: str | None
    value: float | None

    @property
    def experiment(self) -> str:
        """Of which experiment."""
        return self.folder.parts[-3]

    @property
    def method(self) -> str:
        """Of which method."""
        return self.folder.parts[-2]

    @property
    def variant(self) -> str:
        """What differs from the method's own settings."""
        return self.folder.name

    @property
    def status(self) -> str:
        """`running`, `done` or `unfinished`."""
        return "running" if self.busy else "unfinished" if self.unfinished else "done"


def runs(output: Path) -> list[Runs]:
    """The runs of an output folder, by experiment, method and variant.

    Raises:
        UserError: there is no such folder.
    """
    if not output.is_dir():
        raise UserError(f"output={output}: no such folder; `credit train` makes it")
    parents = sorted({folder.parent for folder in output.glob("*/*/*/seed-*") if folder.is_dir()})
    return [_runs(parent) for parent in parents]


def _runs(parent: Path) -> Runs:
    folders = sorted(parent.glob("seed-*"), key=lambda folder: (len(folder.name), folder.name))
    done = tuple(folder for folder in folders if (folder / DONE).exists())
    files = [file.stat() for folder in folders for file in folder.rglob("*") if file.is_file()]
    metric, value = _headline(done)
    return Runs(
        parent,
        done,
        tuple(folder for folder in folders if folder not in done),
        any(Lock(folder / ".lock").held_elsewhere() for folder in folders),
        sum(file.st_size for file in files),
        max((file.st_mtime for file in files), default=parent.stat().st_mtime),
        metric,
        value,
    )


def _headline(done: tuple[Path, ...]) -> tuple[str | None, float | None]:
    """The main metric of some runs, and its mean."""
    found: list[dict[str, Any]] = []
    for folder in done:
        with suppress(OSError, ValueError, LookupError):
            found.append(json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["metrics"])
    for name in HEADLINES:
        if values := [metrics[name] for metrics in found if metrics.get(name) is not None]:
            return name, fmean(values)
    return None, None

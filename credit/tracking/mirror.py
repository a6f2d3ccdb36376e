"""The local journal of a session, mirrored to a tracking store: a sweep, below it jobs, below them seeds.

The journal is the truth. What a store holds of a run, its ledger asks the store, so the work of a mirror that was
killed is continued by the next one.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from credit.tracking.curves import Follower, mean_rows
from credit.tracking.describe import job_card, seed_card, sweep_card
from credit.tracking.entries import Upload
from credit.tracking.ledger import ledger_of
from credit.tracking.notes import Note, one_at_a_time
from credit.tracking.picture import recovery_picture
from credit.tracking.sessions import Seeds, attempt, ledger_file
from credit.tracking.store import kind_of

AUTO_SEEDS = 20
SEED_INTERVAL = 5.0
SEED_FILES = ("config.yaml", "summary.json", "recovery.npz", "trajectories.npz")

Json = dict[str, Any]


@dataclass(frozen=True)
class Progress:
    """How far a mirror is: rows in the store and in the journal, whether all is done, rows sent, what was given up."""

    done: int
    total: int
    closed: bool
    sent: int = 0
    problems: tuple[str, ...] = ()


class Mirror:
    """Uploads what is new in one session's journal.

    Args:
        output: output folder, from which the journal's paths start.
        session: the session's folder; `<kind of store>.json` in it remembers what was uploaded.
        uri: resolved address of the store.
        seeds: which seeds get a run of their own: the first 20 of a job, all, or none.
    """

    def __init__(self, output: Path, session: Path, uri: str, seeds: Seeds = "auto"):
        self._output, self._folder, self._seeds = output, session, seeds
        self._kind, identity = kind_of(uri), _read(session / "session.json")["id"]
        self._ledger = ledger_of(ledger_file(session, uri), uri, output, identity)
        self._journals: dict[int, list[Follower]] = {}
        self._seeds_due: dict[int, float] = {}
        self._waiting: dict[str, int] = {}
        self._finished: dict[int, Json] = {}
        self._claimed: set[str] = set()

    def sync(self, orphaned: bool = False) -> Progress:
        """Upload what is new.

        Args:
            orphaned: the process that wrote the journal is gone, so what still says RUNNING was killed.

        Raises:
            Exception: the store cannot be reached or written now; call again later.
        """
        session = _read(self._folder / "session.json")
        if orphaned and session["status"] == "RUNNING":
            session["status"] = "KILLED"
        ended, closed = session["status"] != "RUNNING", False
        paths = sorted(self._folder.glob("job-*.json"), key=lambda path: int(path.stem.removeprefix("job-")))
        jobs = [_read(path) for path in paths]
        try:
            if session["kind"] == "sweep":
                self._sync_sweeps(session, jobs)
            for job in jobs:
                if ended and job["status"] == "RUNNING":
                    job["status"] = "KILLED"
                if self._finished.get(job["number"]) != job:
                    self._sync_job(session, job)
            entries = self._ledger.entries.values()
            closed = ended and all(entry.status != "RUNNING" or entry.problem for entry in entries)
        finally:
            self._ledger.save(complete=attempt(session) if closed else None)
        done = sum(entry.rows for entry in entries)
        return Progress(
            done=done,
            total=done + sum(self._waiting.values()),
            closed=closed,
            sent=self._ledger.sent,
            problems=tuple(entry.problem for entry in entries if entry.problem),
        )

    def _sync_sweeps(self, session: Json, jobs: list[Json]) -> None:
        """One run a sweep; one in each experiment where its jobs lie in several."""
        last = max((job["finished"] or job["started"] for job in jobs), default=session["started"])
        for experiment in dict.fromkeys(job["experiment"] for job in jobs):
            key, card = _sweep_key(experiment), sweep_card(session)
            finished = session["finished"] or last
            self._ledger.upload(Upload(key, experiment, card, status=session["status"], finished=finished))

    def _sync_job(self, session: Json, job: Json) -> None:
        number = job["number"]
        folders = [self._output / path for path in job["folders"]]
        journals = self._journals.setdefault(number, [Follower(path / "metrics.csv") for path in folders])
        for journal in journals:
            journal.follow()
        seconds = max((journal.rows[-1].seconds for journal in journals if journal.rows), default=0.0)
        finished = job["finished"] or job["started"] + seconds
        self._upload_job(session, job, finished)
        shown = {"auto": AUTO_SEEDS, "all": len(folders), "none": 0}[self._seeds]
        self._upload_seeds(session, job, finished, folders[:shown])
        if job["status"] != "RUNNING":
            self._finished[number] = job
            del self._journals[number]

    def _upload_job(self, session: Json, job: Json, finished: float) -> None:
        key = str(job["number"])
        parent = self._run_id(_sweep_key(job["experiment"])) if session["kind"] == "sweep" else None
        runs = [journal.rows for journal in self._journals[job["number"]]]
        config = yaml.safe_dump(job["config"], sort_keys=False)
        self._ledger.upload(
            Upload(
                key=key,
                experiment=job["experiment"],
                card=job_card(session, job, parent),
                rows=partial(mean_rows, runs, rates=job.get("rates")),
                status=job["status"],
                finished=finished,
                texts=(("config.yaml", config),),
                error=job["error"],
            )
        )

    def _upload_seeds(self, session: Json, job: Json, finished: float, folders: list[Path]) -> None:
        number, begin = job["number"], time.monotonic()
        running = job["status"] == "RUNNING"
        due = not running or begin >= self._seeds_due.get(number, 0.0)
        for seed, folder, journal in zip(job["seeds"], folders, self._journals[number], strict=False):
            key = f"{number}/{seed}"
            with one_at_a_time(folder):
                summary = _summary(folder)
                journal.follow()  # what says that it is finished was written behind its last row
                if not self._owns(key, folder, summary, session["id"], running):
                    self._ledger.forget(key)
                    self._waiting.pop(key, None)
                    continue
                if due:
                    self._upload_seed(session, job, seed, finished, folder, journal, summary)
            entry = self._ledger.entries.get(key)
            self._waiting[key] = len(journal.beyond(entry.step if entry else -1))
        if due and running:
            # The seeds get a tenth of the time at most, so that the curves of the jobs stay live.
            self._seeds_due[number] = begin + max(SEED_INTERVAL, 10 * (time.monotonic() - begin))

    def _upload_seed(
        self, session: Json, job: Json, seed: int, finished: float, folder: Path, journal: Follower, summary: Json
    ) -> None:
        key = f"{job['number']}/{seed}"
        # A seed of a running job may be done, by an earlier attempt; that it failed then says nothing.
        known = summary if summary.get("status") == "FINISHED" or job["status"] != "RUNNING" else {}
        end = {"status": job["status"], "finished": finished}
        end |= known if known.get("session") == session["id"] else {}
        self._ledger.upload(
            Upload(
                key=key,
                experiment=job["experiment"],
                card=seed_card(session, job, seed, self._run_id(str(job["number"]))),
                rows=journal.beyond,
                status=end["status"],
                finished=end["finished"],
                picture=partial(recovery_picture, folder / "recovery.npz"),
                files=[folder / name for name in SEED_FILES if (folder / name).exists()],
                folder=folder,
            )
        )
        self._claimed.add(key)

    def _owns(self, key: str, folder: Path, summary: Json, session: str, running: bool) -> bool:
        """Whether a seed's run is this session's to write: it is that of the session which filled the folder last.

        Two sessions may list one folder: one began it, another goes on. A job that runs takes the run over when it
        is first seen, and leaves it to whoever takes it over later; a summary says who did the work in the end.
        """
        writer, note = summary.get("session"), Note.read(folder, self._kind)
        if summary.get("status") == "FINISHED" or (writer == session and not running):
            return bool(writer == session)
        if running and key not in self._claimed:
            return True
        return note is None or note.session == session

    def _run_id(self, key: str) -> str | None:
        entry = self._ledger.entries.get(key)
        return entry.id if entry else None


def _sweep_key(experiment: str) -> str:
    return f"sweep {experiment}"


def _read(path: Path) -> Json:
    content: Json = json.loads(path.read_text())
    return content


def _summary(folder: Path) -> Json:
    path = folder / "summary.json"
    return _read(path) if path.exists() else {}

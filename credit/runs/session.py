"""A session is one `credit train`: its folder records the jobs, so that anybody can follow from outside.

The same command typed again, after its session failed or died, goes on with that session: what it had made in MLflow
is continued, not made twice.
"""

from __future__ import annotations

import json
import os
import secrets
import shlex
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from credit.runs.differing import Label
from credit.runs.journal import git_commit, write_json
from credit.runs.locks import Lock

Plan = list[dict[str, Any]]


def new_session_id() -> str:
    """A name that sorts by time: 20261122-201500-3f2a."""
    return f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(2)}"


class Session:
    """The record of one command in `<output>/sessions/<id>/session.json`.

    Args:
        output: the output folder.
        identifier: the session's id.
    """

    def __init__(self, output: Path, identifier: str) -> None:
        self.output = output
        self.id = identifier
        self.folder = output / "sessions" / identifier
        self._lock = Lock(self.folder / ".lock", f"session {identifier}")
        self._facts: dict[str, Any] = {}

    @classmethod
    def unfinished(cls, output: Path, plan: Plan) -> Session | None:
        """The newest session of this plan that has not finished and that nobody works on, locked; or none."""
        for file in sorted(output.glob("sessions/*/session.json"), reverse=True):
            with suppress(OSError, ValueError, KeyError):
                facts = json.loads(file.read_text(encoding="utf-8"))
                if facts["plan"] != plan:
                    continue
                session = cls(output, facts["id"])
                if facts["status"] != "FINISHED":
                    return session if session._lock.take() else None
        return None

    @classmethod
    def begin(
        cls,
        output: Path,
        kind: str,
        experiment: str,
        argv: Sequence[str],
        tracking: dict[str, Any] | None,
        plan: Plan,
        config_dirs: Sequence[str] = (),
        labels: Sequence[Label] = (),
    ) -> Session:
        """Go on with the unfinished session of a plan, or start one; it says that it runs until `finish`.

        Args:
            output: the output folder. kind: `job` or `sweep`. experiment: of the first job.
            argv: the words after `credit`. tracking: the tracking node. plan: of every job, as `job.plan` has it.
            config_dirs: further folders of YAML files, absolute. labels: what tells each job from the others.
        """
        session = cls.unfinished(output, plan)
        if session is None:
            session = cls._new(output)
        session._start(kind, experiment, argv, tracking, plan, config_dirs, labels)
        return session

    @classmethod
    def _new(cls, output: Path) -> Session:
        """A session of a name that nobody has, locked."""
        while True:
            session = cls(output, new_session_id())
            with suppress(FileExistsError):  # hundreds of commands start in the same second on a cluster
                session.folder.mkdir(parents=True)
                session._lock.take()
                return session

    def _start(
        self,
        kind: str,
        experiment: str,
        argv: Sequence[str],
        tracking: dict[str, Any] | None,
        plan: Plan,
        config_dirs: Sequence[str],
        labels: Sequence[Label],
    ) -> None:
        path = self.folder / "session.json"
        earlier = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        self._facts = {
            "id": self.id,
            "kind": kind,
            "experiment": experiment,
            "argv": list(argv),
            "command": shlex.join(["credit", *argv]),
            "config_dirs": [str(Path(folder).resolve()) for folder in config_dirs],
            "started": earlier.get("started", time.time()),
            "finished": None,
            "status": "RUNNING",
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "process_started": psutil.Process().create_time(),
            "tracking": tracking,
            "plan": plan,
            "labels": list(labels),
        }
        write_json(path, self._facts)

    def finish(self, status: str) -> None:
        """Say how the session ended."""
        self._facts |= {"finished": time.time(), "status": status}
        try:
            write_json(self.folder / "session.json", self._facts)
        finally:
            self._lock.release()


class JobRecord:
    """The record of one job of a session, `job-<number>.json`: what it computes, where, and how it ended.

    Where an earlier attempt of the session left one, its seeds and its start stay. `data` is name → seed → digest.
    """

    def __init__(self, session: Session, number: int, started: float, facts: dict[str, Any]) -> None:
        self._path = session.folder / f"job-{number}.json"
        earlier = json.loads(self._path.read_text(encoding="utf-8")) if self._path.exists() else {}
        where = dict(zip(earlier.get("seeds", []), earlier.get("folders", []), strict=True))
        where |= dict(zip(facts["seeds"], facts["folders"], strict=True))
        seeds = sorted(where)
        data = {name: earlier.get("data", {}).get(name, {}) | digests for name, digests in facts["data"].items()}
        self.facts: dict[str, Any] = {
            "id": f"{session.id}-{number}",
            "session": session.id,
            "number": number,
            **facts,
            "seeds": seeds,
            "folders": [where[seed] for seed in seeds],
            "data": data,
            "status": "RUNNING",
            "started": earlier.get("started", started),
            "finished": None,
            "error": None,
            "git_commit": git_commit(),
        }
        write_json(self._path, self.facts)

    @staticmethod
    def settle(session: Session, number: int) -> None:
        """Say that a job, all of whose runs are done, has finished, where it was killed before it could."""
        path = session.folder / f"job-{number}.json"
        if path.exists():
            facts = json.loads(path.read_text(encoding="utf-8"))
            if facts["status"] != "FINISHED":
                write_json(path, facts | {"status": "FINISHED", "finished": time.time(), "error": None})

    def finish(self, status: str, error: str | None = None) -> None:
        """Say how the job ended."""
        self.facts |= {"status": status, "finished": time.time(), "error": error}
        write_json(self._path, self.facts)

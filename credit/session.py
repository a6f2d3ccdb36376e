"""A session is one `credit train`: its folder records the jobs, so that anybody can follow from outside."""

from __future__ import annotations

import os
import secrets
import socket
import time
from pathlib import Path
from typing import Any

from credit.tracking.journal import git_commit, write_json


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
        self._facts: dict[str, Any] = {}

    def start(self, kind: str, experiment: str, command: str, tracking: dict[str, Any] | None) -> None:
        """Create the folder and say that the session runs."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._facts = {
            "id": self.id,
            "kind": kind,
            "experiment": experiment,
            "command": command,
            "started": time.time(),
            "finished": None,
            "status": "RUNNING",
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "tracking": tracking,
        }
        write_json(self.folder / "session.json", self._facts)

    def finish(self, status: str) -> None:
        """Say how the session ended."""
        self._facts |= {"finished": time.time(), "status": status}
        write_json(self.folder / "session.json", self._facts)


class JobRecord:
    """The record of one job of a session, `job-<number>.json`: what it computes, where, and how it ended."""

    def __init__(self, session: Session, number: int, started: float, facts: dict[str, Any]) -> None:
        self._path = session.folder / f"job-{number}.json"
        self.facts: dict[str, Any] = {
            "id": f"{session.id}-{number}",
            "session": session.id,
            "number": number,
            **facts,
            "status": "RUNNING",
            "started": started,
            "finished": None,
            "error": None,
            "git_commit": git_commit(),
        }
        write_json(self._path, self.facts)

    def finish(self, status: str, error: str | None = None) -> None:
        """Say how the job ended."""
        self.facts |= {"status": status, "finished": time.time(), "error": error}
        write_json(self._path, self.facts)

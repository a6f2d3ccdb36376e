"""Tracking: what becomes of a session's local journal while it grows.

A trainer writes the journal and never waits for a tracking store: another process mirrors it to MLflow.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from credit.component import Component
from credit.tracking.store import quiet_environment, resolve_uri, uri_problem

Seeds = Literal["auto", "all", "none"]
PROGRESS_FILE, LOG_FILE = "tracking.json", "tracking.log"
_ROOT = Path(__file__).resolve().parents[2]


class Tracking(Component):
    """Follows the journal of one session from outside."""

    @abstractmethod
    def check(self, output: Path) -> list[str]:
        """Problems that can be found before anything is made; nothing is opened or created."""

    @abstractmethod
    def start(self, session_dir: Path, output: Path) -> None:
        """Begin to follow a session whose `session.json` exists; returns at once and never fails."""

    @abstractmethod
    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Wait, after `session.json` says that the session ended, until everything is uploaded.

        Args:
            timeout: seconds to wait at most; None waits as long as there is hope.
            on_progress: called now and then with (rows uploaded, rows in all).

        Returns:
            One line about what could not be uploaded, or None.
        """


class NoTracking(Tracking):
    """The local journal only."""

    def check(self, output: Path) -> list[str]:
        """Nothing can be wrong."""
        return []

    def start(self, session_dir: Path, output: Path) -> None:
        """Nothing to begin."""

    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Nothing to wait for."""
        return None


class MLflowTracking(Tracking):
    """Mirrors the journal to MLflow, live, from a process of its own.

    Args:
        uri: tracking URI; None is `mlflow.db` in the output folder.
        seeds: which seeds get a run of their own: `auto` (the first 20 of a job), `all` or `none`. The
            curves of a job are means over all of its seeds in any case.
    """

    def __init__(self, uri: str | None = None, seeds: Seeds = "auto"):
        self.uri, self.seeds = uri, seeds
        self._process: subprocess.Popen[bytes] | None = None
        self._session = Path()
        self._command: list[str] = []
        self._problem = ""

    def check(self, output: Path) -> list[str]:
        """A tracking URI that is none."""
        problem = uri_problem(self.uri)
        return [problem] if problem else []

    def start(self, session_dir: Path, output: Path) -> None:
        """Start the uploader; what it has to say goes to `tracking.log` in the session's folder."""
        self._session = session_dir.resolve()
        output = output.resolve()
        self._command = ["-m", "credit.tracking.uploader", "--session", str(self._session)]
        self._command += ["--output", str(output)]
        choices = ["--uri", resolve_uri(self.uri, output), "--seeds", self.seeds]
        choices += ["--parent", str(os.getpid())]
        path = os.pathsep.join([str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        try:
            with (self._session / LOG_FILE).open("ab") as log:
                self._process = subprocess.Popen(
                    [sys.executable, *self._command, *choices],
                    env=quiet_environment() | {"PYTHONPATH": path},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # a Ctrl-C in the terminal must not stop the last upload
                )
        except OSError as error:
            self._problem = str(error)

    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Wait for the uploader, stop it after `timeout` seconds; the line says how to upload the rest."""
        end = None if timeout is None else time.monotonic() + timeout
        process, late = self._process, ""
        while process is not None and process.poll() is None:
            if end is not None and time.monotonic() > end:
                process.terminate()
                process.wait()
                late = "the store is too slow"
                break
            if on_progress is not None:
                on_progress(*self._progress()[:2])
            time.sleep(0.1)
        done, total, problem = self._progress()
        if on_progress is not None:
            on_progress(done, total)
        if process is not None and process.returncode == 0:
            return None
        reason = self._problem or problem or late or "the uploader failed"
        again = " ".join(["python", *self._command])
        return (
            f"MLflow: not everything was uploaded ({reason}); the journal is complete. "
            f"Details: {self._session / LOG_FILE}. To upload the rest: {again}"
        )

    def _progress(self) -> tuple[int, int, str]:
        try:
            state = json.loads((self._session / PROGRESS_FILE).read_text())
        except OSError:
            return 0, 0, ""
        return state["done"], state["total"], state["problem"]

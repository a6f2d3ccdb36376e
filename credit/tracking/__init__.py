"""Tracking: what becomes of a session's local journal while it grows.

A trainer writes the journal and never waits for a tracking store: another process mirrors it to MLflow.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path

from credit.core.component import Component
from credit.tracking.sessions import Seeds, State
from credit.tracking.store import VARIABLE, quiet_environment, resolve_uri, uri_problem

LOG_FILE = "tracking.log"
LASTING = 3.0  # seconds of failures that are worth a line: what is shorter repairs itself
GRACE = 8.0  # seconds for a store that fails, once the session has ended
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
    def news(self) -> str | None:
        """A line when something has gone wrong for good, once; None at all other times. Cheap: may be called often."""

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

    def news(self) -> str | None:
        """Nothing can go wrong."""
        return None

    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Nothing to wait for."""
        return None


class MLflowTracking(Tracking):
    """Mirrors the journal to MLflow, live, from a process of its own.

    Args:
        uri: tracking URI; None is that of the environment (MLFLOW_TRACKING_URI), or `mlflow.db` in the output folder.
        seeds: which seeds get a run of their own: `auto` (the first 20 of a job), `all` or `none`. The
            curves of a job are means over all of its seeds in any case.
    """

    def __init__(self, uri: str | None = None, seeds: Seeds = "auto"):
        self.uri, self.seeds = uri if uri is not None else os.environ.get(VARIABLE) or None, seeds
        self.process: subprocess.Popen[bytes] | None = None
        self._session, self._output = Path(), Path()
        self._problem = ""
        self._told = False

    def check(self, output: Path) -> list[str]:
        """A tracking URI that is none."""
        problem = uri_problem(self.uri)
        return [problem] if problem else []

    def start(self, session_dir: Path, output: Path) -> None:
        """Start the uploader; what it has to say goes to `tracking.log` in the session's folder."""
        self._session, self._output = session_dir.resolve(), output.resolve()
        State(resolve_uri(self.uri, self._output), self.seeds).write(self._session)
        self._launch()

    def _launch(self) -> None:
        command = [sys.executable, "-m", "credit.tracking.uploader", "--session", str(self._session)]
        command += ["--output", str(self._output), "--uri", resolve_uri(self.uri, self._output)]
        command += ["--seeds", self.seeds, "--parent", str(os.getpid())]
        path = os.pathsep.join([str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        try:
            with (self._session / LOG_FILE).open("ab") as log:
                self.process = subprocess.Popen(
                    command,
                    env=quiet_environment() | {"PYTHONPATH": path},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # a Ctrl-C in the terminal must not stop the last upload
                )
        except OSError as error:
            self._problem = str(error)

    def news(self) -> str | None:
        """Says once that the store does not take what it is sent, or that nobody sends it any more."""
        if self._told:
            return None
        state = State.read(self._session)
        if self.process is None or self.process.poll() is not None:
            reason = self._problem or "the uploader died"
        elif state is not None and state.since is not None and time.time() - state.since >= LASTING:
            reason = f"{state.uri}: {state.problem}"
        else:
            return None
        self._told = True
        return f"MLflow does not take the metrics now ({reason}). The run goes on, its journal is complete"

    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Wait for the uploader; a store that fails gets a few seconds. The line says how to upload the rest."""
        begin, late = time.monotonic(), ""
        state = State.read(self._session)
        if (self.process is None or self.process.poll() is not None) and not (state and state.ended):
            self._launch()  # something killed it
        while self.process is not None and self.process.poll() is None:
            state = State.read(self._session)
            if on_progress is not None and state is not None:
                on_progress(state.done, state.total)
            if state is not None and state.ended:  # it may go on with what earlier sessions left
                break
            waited = time.monotonic() - begin
            if (timeout is not None and waited > timeout) or (state and state.since and waited > GRACE):
                self.process.terminate()
                self.process.wait()
                late = "the store is too slow"
                break
            time.sleep(0.1)
        state = State.read(self._session)
        if on_progress is not None and state is not None:
            on_progress(state.done, state.total)
        if state is not None and state.ended and not state.problem:
            return None
        reason = self._problem or (state.problem if state else "") or late or "the uploader failed"
        where = "" if self._output == Path("outputs").resolve() else f" {shlex.quote(str(self._output))}"
        return (
            f"MLflow: not everything was uploaded ({reason}); the journal is complete. "
            f"Details: {self._session / LOG_FILE}. To upload the rest: credit sync{where}"
        )

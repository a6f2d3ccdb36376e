"""What every tracker with a store shares: another process mirrors the journal to it, and nobody waits for that."""

from __future__ import annotations

import importlib.util
import os
import shlex
import subprocess
import sys
import time
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from credit.tracking.seam import Tracking
from credit.tracking.sessions import Seeds, State
from credit.tracking.store import quiet_environment

LOG_FILE = "tracking.log"
LASTING = 3.0  # seconds of failures that are worth a line: what is shorter repairs itself
GRACE = 8.0  # seconds for a store that fails, once the session has ended
_ROOT = Path(__file__).resolve().parents[2]


class Mirrored(Tracking):
    """Mirrors the journal to a store, live, from a process of its own.

    A kind says its `title`, the `package` that it needs, which is an extra of credit's, too, and where its store is.

    Args:
        seeds: which seeds get a run of their own: `auto` (the first 20 of a job), `all` or `none`. The
            curves of a job are means over all of its seeds in any case.
    """

    title: ClassVar[str]
    package: ClassVar[str]

    def __init__(self, seeds: Seeds = "auto"):
        self.seeds = seeds
        self.process: subprocess.Popen[bytes] | None = None
        self._session, self._output = Path(), Path()
        self._problem = ""
        self._told = False

    @abstractmethod
    def address(self, output: Path) -> str:
        """The resolved address of the store; its scheme is the module of the kind."""

    def check(self, output: Path) -> list[str]:
        """The package is missing."""
        problem = missing(self.package)
        return [problem] if problem else []

    def start(self, session_dir: Path, output: Path) -> None:
        """Start the uploader; what it has to say goes to `tracking.log` in the session's folder."""
        self._session, self._output = session_dir.resolve(), output.resolve()
        State(self.address(self._output), self.seeds).write(self._session)
        self._launch()

    def _launch(self) -> None:
        command = [sys.executable, "-m", "credit.tracking.uploader", "--session", str(self._session)]
        command += ["--output", str(self._output), "--uri", self.address(self._output)]
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
        return f"{self.title} does not take the metrics now ({reason}). The run goes on, its journal is complete"

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
            f"{self.title}: not everything was uploaded ({reason}); the journal is complete. "
            f"Details: {self._session / LOG_FILE}. To upload the rest: credit sync{where}"
        )


def missing(package: str) -> str | None:
    """What to do where a tracker's package is not installed; None where it is."""
    if importlib.util.find_spec(package) is not None:
        return None
    return (
        f"{package} is not installed, which tracking={package} needs: "
        f"pip install 'credit-rl[{package}]', or take tracking=none"
    )

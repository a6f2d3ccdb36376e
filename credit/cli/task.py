"""One job as a launcher runs it: in this process, in a worker beside it, or on another machine."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import psutil

from credit.cli.board import Board
from credit.cli.modules import findable
from credit.runs.headlines import HEADLINES

BEAT = 1.0  # seconds between two looks at the command, and between two posts


@dataclass(frozen=True)
class Parent:
    """The process of the command, by what survives a process id that is used again."""

    host: str = field(default_factory=socket.gethostname)
    pid: int = field(default_factory=os.getpid)
    started: float = field(default_factory=lambda: psutil.Process().create_time())

    def here(self) -> bool:
        """Whether this is the command's own process."""
        return self.host == socket.gethostname() and self.pid == os.getpid()

    def gone(self) -> bool:
        """Whether it is known to have died; of a process on another machine nothing is known."""
        if self.host != socket.gethostname():
            return False
        try:
            process = psutil.Process(self.pid)
            return process.create_time() != self.started or process.status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return True


@dataclass(frozen=True)
class Task:
    """What Hydra's launchers call, once a job; it can be pickled.

    Args:
        folder: the command's working folder. output: the output folder. session: the session's id.
        numbers: of the jobs, in the order of the launch. parent: the command's process.
    """

    folder: Path
    output: Path
    session: str
    numbers: tuple[int, ...]
    parent: Parent

    def __call__(self, composed: Any) -> None:
        """Run the job that Hydra has just composed, and post how it ended."""
        from credit.config.launchers import job_number
        from credit.runs.session import Session

        os.chdir(self.folder)  # a worker may have served another command, or have come to life elsewhere
        session = Session(self.output, self.session)
        board = Board(session.folder)
        number = self.numbers[job_number()]
        if board.stopped() or (not self.parent.here() and self.parent.gone()):
            return  # the terminal says that it was not run
        with findable(self.folder), interruptible(self.parent.here()), Pulse(board, number, self.parent) as pulse:
            self._run(session, board, number, pulse)

    def _run(self, session: Any, board: Board, number: int, pulse: Pulse) -> None:
        from credit.core.errors import UserError

        config, overrides = board.job(number)
        ended: dict[str, Any] = {"status": "FAILED", "title": config["title"]}
        started = time.time()
        interruption: KeyboardInterrupt | None = None
        try:
            from credit.runs.runner import run_job  # takes seconds, in which one may be interrupted
            from credit.runs.threads import limited

            with limited(1):  # a worker a core
                result = run_job(config, overrides, session, number, pulse.progress, signals=True)
            pulse.halt()
            values = {key: float(result.metrics[key].mean()) for key in HEADLINES if key in result.metrics}
            seeds = {name: len(getattr(result, name, ())) for name in ("computed", "skipped", "resumed")}
            ended = {"status": result.status, "title": result.title, "error": result.error, "values": values, **seeds}
            ended |= {"seconds": result.seconds}
        except KeyboardInterrupt as error:
            ended |= {"status": "KILLED"}
            interruption = error
        except UserError as error:
            ended |= {"error": str(error)}
        except Exception as error:  # a full disk, a bug: the sweep goes on
            ended |= {"error": f"{type(error).__name__}: {error}"}
            with suppress(OSError), (session.folder / f"job-{number}.log").open("a", encoding="utf-8") as log:
                log.write(traceback.format_exc())
        pulse.end({"seconds": time.time() - started, **ended})
        if ended["status"] == "FAILED" and config["sweep"].get("on_error") == "stop":
            board.stop("failed")
        if interruption and self.parent.here():
            raise interruption


class Pulse:
    """A thread beside a job: it posts how far the job is, and in a worker it passes on the command's wish to stop.

    Launchers differ in what becomes of their workers' signals, and a worker on another machine gets none: so the wish
    is a file, and what a job sees is a SIGTERM of its own process. It sees one too when the command has died.
    """

    def __init__(self, board: Board, number: int, parent: Parent) -> None:
        self._board, self._number, self._parent = board, number, parent
        self._facts: dict[str, Any] = {"state": "running", "title": "", "steps": 0, "total": 0}
        self._since: dict[str, float] | None = None  # from where on its pace is measured
        self._over = threading.Event()
        self._asked = False
        self._thread = threading.Thread(target=self._beat, name="pulse", daemon=True)

    def __enter__(self) -> Pulse:
        if not self._parent.here():
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the command's to hear; a second copy would kill
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self.halt()
        if not self._parent.here() and self._parent.gone():
            os._exit(1)  # nobody waits for this worker any more

    def progress(self, title: str, steps: int, total: int) -> None:
        """How far the job is; the title says what it has come to. Costs nothing: the thread writes."""
        self._since = self._since or {"steps": steps, "time": time.time()}
        self._facts = {"state": "running", "title": title, "steps": steps, "total": total, "since": self._since}

    def end(self, facts: dict[str, Any]) -> None:
        """The job ended: post it."""
        self.halt()
        self._board.post(self._number, {"state": "ended", **facts})

    def halt(self) -> None:
        """Post no more, and hear no more wishes."""
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        while True:
            with suppress(OSError):  # a full disk is for the job to report
                self._board.post(self._number, self._facts | {"beat": time.time()})
            if not self._parent.here():
                self._listen()
            if self._over.wait(BEAT):
                return

    def _listen(self) -> None:
        stop = self._board.stopped()
        if stop == "now":
            os.kill(os.getpid(), signal.SIGKILL)
        if not self._asked and not self._over.is_set() and (stop == "interrupted" or self._parent.gone()):
            self._asked = True
            os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def interruptible(interactive: bool) -> Iterator[None]:
    """A SIGTERM ends a job as Ctrl-C does; Ctrl-C itself is for the process at the terminal alone."""

    def stop(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    numbers = (signal.SIGTERM, signal.SIGINT) if interactive else (signal.SIGTERM,)
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

"""A session that launches jobs: all at once, or as they come, until all have ended or somebody stops it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console

from credit.cli.board import Board
from credit.cli.common import Words
from credit.cli.follow import Follower
from credit.cli.outcome import Job, status
from credit.cli.task import BEAT, Parent, Task
from credit.config import launchers
from credit.runs.differing import Label

ATTEMPTS = 3  # how often a launcher is started that breaks: a worker that is killed for memory takes others with it
SILENT = 30 * BEAT  # a job that has posted nothing for so long does not run any more


class Begun:
    """A session that has begun: it launches jobs, now and later, until it is left; then `finish`.

    Args:
        words, argv: what was typed. launcher: what `launchers.choose` returned.
        first: the configuration of the first job, which says where all goes.
        plan: what tells the session from others; one that was killed is gone on with. console: where news go.
        multirun: whether it is of several jobs. total: of how many, where they come by and by; then nothing is said of
            those that end well. labels: what tells each job from the others, for trackers.

    Attributes:
        ended: the session's status, KILLED until somebody knows better. jobs: those that were launched, by number.
    """

    def __init__(
        self,
        words: Words,
        launcher: list[str],
        argv: list[str],
        first: dict[str, Any],
        plan: list[dict[str, Any]],
        console: Console,
        multirun: bool,
        total: int | None = None,
        labels: Sequence[Label] = (),
    ) -> None:
        from credit.config import schema
        from credit.runs.job import Job as Facts
        from credit.runs.session import Session

        self._launcher, self._config_dirs, self._console = launcher, words.config_dirs, console
        kind, output = "sweep" if multirun else "job", Facts.of(first).folder
        self.session = Session.begin(
            output, kind, first["experiment"], argv, first["tracking"], plan, words.config_dirs, labels
        )
        self.jobs: dict[int, Job] = {}
        self.ended = "KILLED"
        self._board = Board(self.session.folder)
        self._board.clear()
        self._tracking = schema.build(first, "tracking")
        self._tracking.start(self.session.folder, self.session.output)
        news, quiet = self._tracking.news, total is not None
        many = total if total is not None else len(plan)
        self.follower = Follower(self._board, self.jobs, console, news, many, quiet)
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Begun:
        self._stack.enter_context(self.follower)
        self._stack.enter_context(stoppable(self._board, self.follower, self._console))
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self._stack.__exit__(kind, value, at)

    def launch(self, jobs: Mapping[int, Job]) -> dict[int, str]:
        """Run checked jobs, by their numbers; how each stands behind it, as `credit.cli.outcome.status` has it.

        Raises:
            KeyboardInterrupt: after Ctrl-C; what was reached is kept.
        """
        self._board.lay(jobs)
        self.jobs.update(jobs)
        launch(self._launcher, jobs, self.session, self._board, self.follower, self._config_dirs)
        facts = self._board.read()
        return {number: status(facts.get(number)) for number in jobs}

    def error(self, number: int) -> str:
        """Why a job failed."""
        return str(self._board.read().get(number, {}).get("error") or "it was not run")

    def finish(self) -> str | None:
        """Say how the session ended, and wait for its upload; what is still to be uploaded."""
        self.session.finish(self.ended)
        late = drain(self._tracking, self._console)
        self._board.end()
        return late


def launch(
    launcher: list[str], jobs: Mapping[int, Job], session: Any, board: Board, follower: Follower, config_dirs: list[str]
) -> None:
    """Hand the jobs to Hydra's launcher; if that breaks, hand it again those that have not ended."""
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # of workers
    trouble: dict[int, str] = {}
    for _ in range(ATTEMPTS):
        left = tuple(number for number in jobs if not follower.ended(number))
        if not left or board.stopped():
            break
        task = Task(Path.cwd(), session.output, session.id, left, Parent())
        place = {"session": session.id, "output": str(session.output)}
        try:
            errors = launchers.launch(task, len(left), launcher, place, config_dirs)
        except Exception as error:  # whatever a launcher may raise when a worker or a node dies
            trouble = dict.fromkeys(left, f"{type(error).__name__}: {str(error).strip().partition(os.linesep)[0]}")
        else:
            trouble = {left[index]: error for index, error in errors.items()}
            break
    if board.stopped() in ("interrupted", "now"):
        raise KeyboardInterrupt
    for number, reason in trouble.items():
        if not follower.ended(number) and not board.stopped():
            ended = {"state": "ended", "status": "FAILED", "title": jobs[number][0]["title"]}
            board.post(number, ended | {"error": f"the launcher: {reason}"})


@contextlib.contextmanager
def stoppable(board: Board, follower: Follower, console: Console) -> Iterator[None]:
    """Ctrl-C and SIGTERM: the jobs stop after a checkpoint; a second one ends all at once.

    A job in this process hears the signal itself; workers are told by the board.
    """
    over = threading.Event()

    def ended() -> None:
        """Leave a launcher that waits for jobs which nobody will run."""
        while any(time.time() - facts.get("beat", 0) < SILENT for facts in follower.running()):
            if over.wait(BEAT):
                return
        if not over.wait(2 * BEAT):
            signal.raise_signal(signal.SIGINT)

    def stop(number: int, frame: Any) -> None:
        if board.stopped() in ("interrupted", "now"):
            board.stop("now")
            raise KeyboardInterrupt
        board.stop("interrupted")
        console.print("stopping: jobs write a checkpoint first; once more ends them at once")
        threading.Thread(target=ended, daemon=True).start()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        over.set()
        for number, handler in before.items():
            signal.signal(number, handler)


def drain(tracking: Any, console: Console) -> str | None:
    """Wait for what is still to be uploaded."""
    with console.status("tracking") if console.is_terminal else contextlib.nullcontext() as status:

        def progress(done: int, total: int) -> None:
            if status is not None:
                status.update(f"tracking: {done} of {total} rows")

        late: str | None = tracking.finish(timeout=120.0, on_progress=progress)
    return late

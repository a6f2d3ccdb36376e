"""`credit train`: one job, or a sweep with -m."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console

from credit.cli.board import Board
from credit.cli.common import Words, help_text
from credit.cli.follow import Follower, Job, counts, shown, status, table
from credit.cli.main import guarded
from credit.cli.task import BEAT, Parent, Task
from credit.config import launchers, registry, sweeps
from credit.core.errors import UserError

ATTEMPTS = 3  # how often a launcher is started that breaks: a worker that is killed for memory takes others with it
SILENT = 30 * BEAT  # a job that has posted nothing for so long does not run any more


def main(argv: list[str]) -> int:
    """Check everything, then run, then say how it went, where the runs lie and what to type next."""
    words = Words.parse(argv, flags=("-m", "--multirun"))
    if words.help:
        print(help_text("train", "[-m] [group=option] [key=value] ...", words.config_dirs))
        return 0
    multirun = several(words)
    if not multirun and (swept := [text for text in words.overrides if registry.is_sweep(text)]):
        raise UserError(f"{swept[0]!r} names several values: add -m to run a sweep, or give one")
    jobs, console = checked_jobs(words, multirun), Console(stderr=True, highlight=False)
    ended, late, parents, session = computed(words, jobs, ["train", *argv], console, multirun)
    report(parents, jobs[0][0], late, None if ended == "FINISHED" else session)
    return 0 if ended == "FINISHED" else 1


def computed(
    words: Words, jobs: list[Job], argv: list[str], console: Console, multirun: bool, told: bool = True
) -> tuple[str, str | None, list[Path], Path]:
    """Run checked jobs.

    Args:
        words, jobs: what was typed, and what it comes to. argv: as the session is told it. console: where news go.
        multirun: whether it is a sweep. told: whether a sweep's table is printed at the end.

    Returns:
        The session's status, what is still to be uploaded, the folders of the runs, and that of the session.
    """
    launcher = launchers.choose(words.overrides, len(jobs), uses_gpu(jobs), words.config_dirs)

    from credit.config import schema
    from credit.runs.differing import labels
    from credit.runs.job import Job as Facts
    from credit.runs.job import plan
    from credit.runs.runner import place
    from credit.runs.session import Session

    parents = {place(config): None for config, _ in jobs}
    first = jobs[0][0]
    session = Session.begin(
        Facts.of(first).folder,
        "sweep" if multirun else "job",
        first["experiment"],
        argv,
        first["tracking"],
        [plan(config) for config, _ in jobs],
        words.config_dirs,
        labels([config for config, _ in jobs]),
    )
    board = Board(session.folder)
    board.clear(jobs)
    tracking = schema.build(first, "tracking")
    tracking.start(session.folder, session.output)
    follower, ended = Follower(board, jobs, console, tracking.news), "KILLED"
    try:
        with follower, stoppable(board, follower, console):
            launch(launcher, jobs, session, board, follower, words.config_dirs)
        stands = [status(follower.facts.get(number)) for number in range(len(jobs))]
        ended = "FINISHED" if {*stands} <= {"done", "done before"} else "FAILED"
    finally:
        if multirun and told:
            show(follower, jobs)
        session.finish(ended)
        late = drain(tracking, console)
        board.end()
    return ended, late, [*parents], session.folder


def several(words: Words) -> bool:
    """Whether the command is a sweep: `-m`, or a sweep from a file, which is nothing else."""
    return bool(words.flags) or any(registry.is_sweep_file(text) for text in words.overrides)


def checked_jobs(words: Words, multirun: bool) -> list[Job]:
    """The checked configuration and the overrides of every job; of a sweep's jobs that are one, the first.

    A word has an effect in at least one job; in a sweep, jobs in which it has none are what they are without it.

    Raises:
        UserError: with the problems of all jobs, each once.
    """
    from credit.runs import effects
    from credit.runs.job import plan
    from credit.runs.runner import compose

    jobs = sweeps.expand(words.overrides, words.config_dirs) if multirun else [words.overrides]
    found, problems, remarks = dict[str, Job](), dict[str, None](), dict[str, None]()
    useful: set[str] = set()
    useless: dict[str, tuple[str, list[str]]] = {}  # word → its slot, and a job that it is in
    for overrides in jobs:
        without: dict[str, str] = {}
        try:
            config = compose(overrides, config_dirs=words.config_dirs, say=remarks.setdefault, idle=without.update)
        except UserError as error:
            problems.update(dict.fromkeys(str(error).splitlines()))
            continue
        kept = [word for word in overrides if word not in without]
        found.setdefault(json.dumps(plan(config) | {"slug": None}), (config, kept))  # one run may be typed in two ways
        useful.update(kept)
        useless |= {word: (slot, overrides) for word, slot in without.items()}
    for word, (slot, overrides) in useless.items():
        if word not in useful:
            problems |= dict.fromkeys(effects.said(word, slot, overrides, words.config_dirs).splitlines())
    if problems:
        raise UserError("\n".join(problems))
    for remark in remarks:
        print(f"note     {remark}", file=sys.stderr)
    return list(found.values())


def uses_gpu(jobs: list[Job]) -> bool:
    """Whether any job runs on a GPU."""
    from credit.runs.job import device

    return any(device(config["device"]).type == "cuda" for config, _ in jobs)


def launch(
    launcher: list[str], jobs: list[Job], session: Any, board: Board, follower: Follower, config_dirs: list[str]
) -> None:
    """Hand the jobs to Hydra's launcher; if that breaks, hand it again those that have not ended."""
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # of workers
    trouble: dict[int, str] = {}
    for _ in range(ATTEMPTS):
        left = tuple(number for number in range(len(jobs)) if not follower.ended(number))
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


def show(follower: Follower, jobs: list[Job]) -> None:
    """The table of all jobs, and how many of each kind."""
    Console(width=max(100, Console().width), highlight=False).print(table(follower.facts, jobs))
    print("\n".join(counts(follower.facts, jobs)))


def report(parents: list[Any], config: dict[str, Any], late: str | None, failed: Path | None) -> None:
    """Where the runs lie and what to type next: `failed` is the folder of a session that has jobs to be done again."""
    for parent in sorted(parents):
        print(f"runs     {shown(parent)}/seed-*")
    if late:
        print(f"tracking {late}")
    elsewhere = "" if config["output"] == "outputs" else f" output={shlex.quote(str(config['output']))}"
    if failed:
        print(f"next     mend what failed, then credit resume {shlex.quote(str(shown(failed)))}")
    else:
        print(f"next     credit compare experiment={config['experiment']}{elsewhere}")
    from credit.config import schema

    if look := schema.build(config, "tracking").look(Path(config["output"])):
        print(f"         {look}")


def drain(tracking: Any, console: Console) -> str | None:
    """Wait for what is still to be uploaded."""
    with console.status("tracking") if console.is_terminal else contextlib.nullcontext() as status:

        def progress(done: int, total: int) -> None:
            if status is not None:
                status.update(f"tracking: {done} of {total} rows")

        late: str | None = tracking.finish(timeout=120.0, on_progress=progress)
    return late


if __name__ == "__main__":
    sys.exit(guarded("train", sys.argv[1:]))

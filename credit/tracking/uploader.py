"""Mirrors one session to a tracking store, beside the computation: `python -m credit.tracking.uploader`."""

from __future__ import annotations

import argparse
import fcntl
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from credit.tracking.sessions import Seeds, State, attempt, lives, pending, read_session, store_of
from credit.tracking.store import is_gone, quiet_environment, reason

if TYPE_CHECKING:
    from credit.tracking.mirror import Progress

POLL = 1.0
LONGEST_PAUSE = 30.0
PATIENCE = 4.0  # seconds of failures in a row, after the session has ended, until the rest is left to `credit sync`


def upload(
    session: Path,
    output: Path,
    uri: str,
    seeds: Seeds,
    orphaned: Callable[[], bool] = lambda: False,
    patience: float = PATIENCE,
    log: bool = True,
) -> State:
    """Mirror a session until it has ended and everything is uploaded, or until another process goes on with it.

    Args:
        session: the session's folder.
        output: output folder.
        uri: resolved address of the store.
        seeds: which seeds get a run of their own.
        orphaned: says whether the process that writes the journal is gone.
        patience: seconds of failures in a row that are borne once the session has ended.
        log: whether failures are told on the error stream, with their tracebacks; they are in what is returned, too.

    Returns:
        How it ended; `problem` says what could not be uploaded.
    """
    from credit.tracking.mirror import Mirror

    state, mine = State(uri, seeds), attempt(read_session(session))
    mirror: Mirror | None = None
    pause, deadline = POLL, None
    while True:
        alone = orphaned()
        if attempt(read_session(session)) != mine:
            return state
        ended = alone or _over(session)
        try:
            mirror = mirror or Mirror(output, session, uri, seeds)
            progress = mirror.sync(alone)
        except Exception as error:  # whatever a store throws, the run goes on
            problem = reason(error)
            if log:
                _note_failure(problem, state)
            if ended and deadline is None:
                deadline = time.monotonic() + patience
            over = deadline is not None and time.monotonic() >= deadline
            state = replace(state, problem=problem, since=state.since or time.time(), ended=over)
            pause = min(2 * pause, LONGEST_PAUSE)
        else:
            pause, deadline = POLL, None
            state = _after(state, progress)
        state.write(session)
        if state.ended:
            return state
        _sleep(min(pause, POLL) if ended else pause, lambda: orphaned() or _over(session))


def _after(state: State, progress: Progress) -> State:
    problem = "; ".join(problem.splitlines()[0][:300] for problem in progress.problems)
    known = replace(state, done=progress.done, total=progress.total, sent=progress.sent)
    return replace(known, problem=problem, since=None, ended=progress.closed)


def _note_failure(problem: str, state: State) -> None:
    # A server that is down all night says the same thing a thousand times.
    with suppress(OSError):
        print(traceback.format_exc() if problem != state.problem else problem, file=sys.stderr, flush=True)


def _over(session: Path) -> bool:
    return read_session(session)["status"] != "RUNNING"


def _sleep(seconds: float, woken: Callable[[], bool]) -> None:
    """Sleep; a long pause ends at once when there is a reason, so that the end of a session is seen."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        time.sleep(min(left, POLL))
        if left > POLL and woken():
            return


@contextmanager
def alone_on(session: Path, wait: bool) -> Iterator[bool]:
    """Whether no other process uploads this session, now and until the end of the block.

    Args:
        session: the session's folder. wait: for another process to end.
    """
    with (session / ".uploader.lock").open("w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
        else:
            yield True


def catch_up(output: Path) -> None:
    """Upload what the stores lack of sessions that ended before, and mark what was killed; the next start tries again.

    A store that fails is not asked twice.
    """
    failing: set[str] = set()
    for session in pending(output):
        store = store_of(session, output)
        if store is None or store[0] in failing or is_gone(store[0]):
            continue
        with suppress(OSError), alone_on(session, wait=False) as alone:
            if alone and upload(session, output, *store, partial(_dead, session), patience=0).since:
                failing.add(store[0])


def _dead(session: Path) -> bool:
    return not lives(session)


def main(argv: list[str] | None = None) -> int:
    """Command line of the uploader: mirror a session while it runs, and beside it what earlier ones left."""
    parser = argparse.ArgumentParser(prog="python -m credit.tracking.uploader", description=__doc__)
    parser.add_argument("--session", type=Path, required=True, help="the session's folder")
    parser.add_argument("--output", type=Path, required=True, help="the output folder")
    parser.add_argument("--uri", required=True, help="resolved address of the store")
    parser.add_argument("--seeds", choices=get_args(Seeds), required=True, help="seeds with a run of their own")
    parser.add_argument("--parent", type=int, required=True, help="process whose end is the session's end")
    arguments = parser.parse_args(argv)
    os.environ.update(quiet_environment())
    os.nice(10)  # the computation goes first
    earlier = threading.Thread(target=catch_up, args=(arguments.output,))
    with alone_on(arguments.session, wait=True):  # the uploader of an attempt that was killed ends soon
        earlier.start()
        state = upload(
            arguments.session,
            arguments.output,
            arguments.uri,
            arguments.seeds,
            orphaned=lambda: os.getppid() != arguments.parent,
        )
    earlier.join()
    return int(bool(state.problem))


if __name__ == "__main__":
    raise SystemExit(main())

"""Mirrors one session to MLflow, beside the computation or later: `python -m credit.tracking.uploader`."""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import socket
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import psutil

from credit.tracking import PROGRESS_FILE, Seeds
from credit.tracking.store import quiet_environment, resolve_uri

if TYPE_CHECKING:
    from credit.tracking.mirror import Progress

POLL = 1.0
LONGEST_PAUSE = 30.0
PATIENCE = 60.0  # seconds of failures in a row, after the session has ended, until the rest is given up


def upload(
    session: Path,
    output: Path,
    uri: str,
    seeds: Seeds,
    orphaned: Callable[[], bool] = lambda: False,
    patience: float = PATIENCE,
) -> int:
    """Mirror a session until it has ended and everything is uploaded.

    Args:
        session: the session's folder.
        output: output folder.
        uri: resolved address of the store.
        seeds: which seeds get a run of their own.
        orphaned: says whether the process that writes the journal is gone.
        patience: seconds of failures in a row that are borne once the session has ended.

    Returns:
        0, or 1 where something could not be uploaded.
    """
    from credit.tracking.mirror import Mirror

    mirror = Mirror(output, session, uri, seeds)
    pause, progress, bearable = POLL, None, time.monotonic() + patience
    while True:
        alone = orphaned()
        try:
            progress = mirror.sync(alone)
        except Exception as error:  # whatever MLflow throws, the run goes on
            print(traceback.format_exc(), file=sys.stderr, flush=True)
            _report(session, progress, f"{type(error).__name__}: {_first_line(error)}")
            if not alone and _read(session / "session.json")["status"] == "RUNNING":
                bearable = time.monotonic() + patience
            elif time.monotonic() > bearable:
                return 1
            pause = min(2 * pause, LONGEST_PAUSE)
        else:
            bearable, pause = time.monotonic() + patience, POLL
            _report(session, progress, "; ".join(_first_line(problem) for problem in progress.problems))
            if progress.closed:
                return int(bool(progress.problems))
        time.sleep(pause)


def abandoned(output: Path) -> Iterator[Path]:
    """Sessions of this machine that ended, or died, before MLflow was told, say in a power cut."""
    for file in sorted(output.glob("sessions/*/mlflow.json")):
        if any(run["status"] == "RUNNING" and not run["problem"] for run in _read(file)["runs"].values()):
            session = _read(file.parent / "session.json")
            dead = session["status"] != "RUNNING" or not psutil.pid_exists(session["pid"])
            if dead and session["host"] == socket.gethostname():
                yield file.parent


@contextmanager
def _alone_on(session: Path) -> Iterator[bool]:
    """Whether no other process uploads this session, now and until the end of the block."""
    with (session / ".uploader.lock").open("w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def _first_line(problem: object) -> str:
    return (str(problem).splitlines() or [""])[0][:300]


def _report(session: Path, progress: Progress | None, problem: str) -> None:
    done, total = (progress.done, progress.total) if progress else (0, 0)
    temporary = session / f"{PROGRESS_FILE}.tmp"
    temporary.write_text(json.dumps({"done": done, "total": total, "problem": problem}))
    os.replace(temporary, session / PROGRESS_FILE)


def main(argv: list[str] | None = None) -> int:
    """Command line of the uploader; also the way to upload later what could not be uploaded at once."""
    parser = argparse.ArgumentParser(prog="python -m credit.tracking.uploader", description=__doc__)
    parser.add_argument("--session", type=Path, required=True, help="the session's folder")
    parser.add_argument("--output", type=Path, required=True, help="the output folder")
    parser.add_argument("--uri", help="MLflow tracking URI (default: the session's)")
    parser.add_argument("--seeds", choices=get_args(Seeds), help="seeds with a run of their own (default: as before)")
    parser.add_argument("--parent", type=int, help="process whose end is the session's end")
    arguments = parser.parse_args(argv)
    os.environ.update(quiet_environment())
    os.nice(5)  # the computation goes first
    output, session = arguments.output, arguments.session

    def orphaned() -> bool:
        return arguments.parent is not None and os.getppid() != arguments.parent

    status = _upload_alone(session, output, arguments.uri, arguments.seeds, orphaned)
    if status == 0:
        for other in abandoned(output):
            _upload_alone(other, output, None, None, lambda: True, patience=0)
    return status


def _upload_alone(
    session: Path,
    output: Path,
    uri: str | None,
    seeds: Seeds | None,
    orphaned: Callable[[], bool],
    patience: float = PATIENCE,
) -> int:
    chosen = _read(session / "session.json").get("tracking") or {}
    address = resolve_uri(uri or chosen.get("uri"), output)
    with _alone_on(session) as alone:
        if alone:
            return upload(session, output, address, seeds or chosen.get("seeds", "auto"), orphaned, patience)
    print(f"another process uploads {session} already", file=sys.stderr)
    return 1


if __name__ == "__main__":
    raise SystemExit(main())

"""`credit sync`: upload to tracking stores what they lack of earlier sessions."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from credit.cli.main import guarded
from credit.core.errors import UserError
from credit.tracking.mirrored import missing
from credit.tracking.sessions import all_sessions, damaged, lacking, lives, pending, store_of
from credit.tracking.store import is_gone, kind_of, quiet_environment

HELP = """\
Upload to MLflow, or another tracker, what it lacks of earlier sessions: after an outage, a full disk, a power cut.
What it has stays as it is; what a power cut left running is marked as killed. Sessions that run now have an uploader
of their own.

Usage: credit sync [DIR]

  DIR   an output folder, or the folder of one session, which is compared with its store row for row   (outputs)
"""
SECONDS = 2.0  # of failures in a row, until a store is given up


def main(argv: list[str]) -> int:
    """Bring every session of a folder up to date; 1 if a store does not take it."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    if len(argv) > 1 or (argv and argv[0].startswith("-")):
        raise UserError(f"credit sync takes one folder, not {' '.join(argv)!r}; `credit sync --help` says more")
    return sync(Path(argv[0] if argv else "outputs"))


def sync(folder: Path) -> int:
    """Upload what is missing of the sessions of an output folder, or of one session.

    Args:
        folder: an output folder, or the folder of a session.

    Returns:
        The exit code: 1 where something could not be uploaded.

    Raises:
        UserError: it is neither.
    """
    folder = folder.resolve()
    single = (folder / "session.json").exists()
    output = folder.parents[1] if single else folder
    if not single and not all_sessions(output):
        raise UserError(
            f"{folder} is no output folder with sessions, nor a session's folder (outputs/sessions/<id>); "
            "give the folder that `output=` named when training"
        )
    os.environ.update(quiet_environment())
    chosen = [folder] if single else [*filter(lives, all_sessions(output)), *pending(output), *lacking(output)]
    failing: set[str] = set()
    worked = [_sync(session, output, failing) for session in chosen]
    unread = [] if single else damaged(output)
    for line in unread:
        print(line, file=sys.stderr)
    if not chosen and not unread:
        print(f"nothing to upload: MLflow has everything of the sessions in {folder}")
    return 0 if all(worked) and not unread else 1


def _sync(session: Path, output: Path, failing: set[str]) -> bool:
    """Bring one session up to date and say how that went."""
    from credit.tracking.uploader import alone_on, upload

    name, store = session.name, store_of(session, output)
    if store is None:
        print(f"{name}: ran with tracking=none")
        return True
    uri, seeds = store
    if lives(session):
        print(f"{name}: runs now, and uploads itself")
        return True
    if uri in failing:
        return False
    if problem := missing(kind_of(uri)):
        print(f"credit sync: {name}: {problem}", file=sys.stderr)
        return False
    if is_gone(uri):
        print(f"credit sync: {name}: its store {uri} is gone; move its folder back, and sync again", file=sys.stderr)
        return False
    with alone_on(session, wait=False) as alone:
        if not alone:
            print(f"{name}: another process uploads it now")
            return True
        state = upload(session, output, uri, seeds, lambda: not lives(session), SECONDS, log=False)
    if state.since:
        failing.add(uri)
        print(
            f"credit sync: {uri} does not take the metrics: {state.problem}\n"
            "  Nothing is lost: the journals are complete. Type the same again when the store works.",
            file=sys.stderr,
        )
        return False
    print(f"{name}: {state.done} rows in {uri}, {state.sent} of them new")
    if state.problem:
        print(f"credit sync: {name}: left out: {state.problem}", file=sys.stderr)
    return not state.problem


if __name__ == "__main__":
    sys.exit(guarded("sync", sys.argv[1:]))

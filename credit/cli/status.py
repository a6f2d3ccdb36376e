"""`credit status`: which commands run in an output folder and how far they are, from any other terminal."""

from __future__ import annotations

import sys
import time
from itertools import islice
from pathlib import Path

from credit.cli.main import guarded
from credit.cli.outcome import duration
from credit.cli.words import Reader, read_words, whole
from credit.core.errors import UserError
from credit.runs.catalogue import Progress, Session, sessions

LAST = 10
HELP = f"""\
Which `credit train` run, how far they are and when they end; and the last ones that have ended. Changes nothing.

Usage: credit status [KEY=VALUE ...]

  output=DIR   the output folder       (outputs)
  last=N       how many, newest first  ({LAST})
"""
READERS: dict[str, Reader] = {
    "output": ("output", Path, "a folder"),
    "last": ("last", whole(1), "a whole number, 1 or more"),
}


def main(argv: list[str]) -> int:
    """Print the sessions of an output folder, newest first."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    return status(**read_words(argv, READERS, "status"))


def status(output: Path = Path("outputs"), last: int = LAST) -> int:
    """Print the newest sessions.

    Raises:
        UserError: there is none.
    """
    shown = list(islice(sessions(output), last))
    if not shown:
        raise UserError(
            f"output={output}: nothing was run there; `credit train` does, and output=DIR names another folder"
        )
    for session in shown:
        print("\n".join(lines(session)))
    return 0


def lines(session: Session) -> list[str]:
    """A session in a line, what to type where it was killed, and a line for each of its jobs that runs."""
    counts = ", ".join(f"{count} {word}" for word, count in sorted(session.ended.items())) or "none ended"
    jobs = f", {session.jobs} jobs: {counts}" if session.jobs > 1 else ""
    when = time.strftime("%Y-%m-%d %H:%M", time.localtime(session.started))
    took = "" if session.seconds is None else f", {duration(session.seconds)}"
    found = [f"{session.status:<8} {when}{took}{jobs}   {session.command}"]
    found += [f"{'':<8}   {running(progress)}" for progress in session.running]
    if session.status in ("killed", "stopped"):
        found.append(f"{'':<8}   the same command goes on with it")
    return found


def running(progress: Progress) -> str:
    """How far a job is, and when it ends."""
    if not progress.total:
        return f"{progress.title or 'starting'}"
    left = "" if progress.left is None else f", about {duration(progress.left)} left"
    share = progress.steps / progress.total
    return f"{progress.title}: {share:.0%} ({progress.steps:,} of {progress.total:,} steps{left})"


if __name__ == "__main__":
    sys.exit(guarded("status", sys.argv[1:]))

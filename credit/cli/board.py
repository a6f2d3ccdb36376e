"""The board of a running command: how its jobs, in whatever processes, and the terminal tell each other what is up."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from credit.runs.journal import write_atomically, write_json

Stop = Literal["", "failed", "interrupted", "now"]  # run on; begin nothing; stop after a checkpoint; end at once
STOPS: tuple[Stop, ...] = ("", "failed", "interrupted", "now")


class Board:
    """Small files in `<session>/now/`, which every process of a command can reach, on whatever machine.

    Args:
        session: the session's folder.
    """

    def __init__(self, session: Path) -> None:
        self.session = session
        self._folder = session / "now"
        self._seen: dict[int, tuple[tuple[int, ...], dict[str, Any]]] = {}  # number → which file it was, what it says
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Begin: what an earlier attempt left goes."""
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()

    def lay(self, jobs: Mapping[int, tuple[dict[str, Any], list[str]]]) -> None:
        """Lay out the (configuration, overrides) of jobs, for whoever runs them."""
        for number, (config, overrides) in jobs.items():
            write_json(self._folder / f"plan-{number}.json", {"config": config, "overrides": overrides})

    def job(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """The checked configuration and the overrides of a job: exactly what was planned, whatever files say now."""
        facts = json.loads((self._folder / f"plan-{number}.json").read_text(encoding="utf-8"))
        return facts["config"], facts["overrides"]

    def post(self, number: int, facts: dict[str, Any]) -> None:
        """Say how a job is: `state` (running or ended) and whatever else the terminal may show."""
        write_json(self._folder / f"job-{number}.json", facts)

    def read(self) -> dict[int, dict[str, Any]]:
        """Number → the latest facts of every job that has begun."""
        with self._lock:
            for path in self._folder.glob("job-*.json"):
                number = int(path.stem.partition("-")[2])
                with suppress(OSError, ValueError):
                    found = path.stat()  # two files may be of one moment: a clock ticks in milliseconds
                    file = (found.st_mtime_ns, found.st_ino, found.st_size)
                    if self._seen.get(number, ((), {}))[0] != file:
                        self._seen[number] = file, json.loads(path.read_text(encoding="utf-8"))
            return {number: facts for number, (_, facts) in sorted(self._seen.items())}

    def stop(self, how: Stop) -> None:
        """Ask all jobs to stop; a weaker wish does not replace a stronger one."""
        if STOPS.index(how) > STOPS.index(self.stopped()):
            write_atomically(self._folder / "stop", how)

    def stopped(self) -> Stop:
        """Whether, and how, jobs shall stop; without a board there is no command any more that they belong to."""
        with suppress(OSError):
            said = (self._folder / "stop").read_text(encoding="utf-8")
            return next((how for how in STOPS if how == said), "")
        return "" if self._folder.is_dir() else "interrupted"

    def end(self) -> None:
        """All is over; the records of the session stay, the board goes."""
        shutil.rmtree(self._folder, ignore_errors=True)

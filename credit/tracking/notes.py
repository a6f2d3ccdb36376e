"""`mlflow.json` in a run's folder, or what its tracker is called: which run it is there, and which session fills it."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from credit.runs.journal import write_json


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Nobody else looks whose run a folder is, and makes or takes it, until the end of the block.

    The uploader of a killed session and that of the one that goes on may both want to, in two processes or in one.
    """
    with ExitStack() as held:
        with suppress(OSError):  # the folder is not there yet, or its file system has no locks
            handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
            held.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


@dataclass(frozen=True)
class Note:
    """A seed's run: the store, the session that owns it, its key there, its id (empty before it was made)."""

    uri: str
    session: str
    key: str
    run: str

    @classmethod
    def read(cls, folder: Path, kind: str = "mlflow") -> Note | None:
        """The note of a run folder on a kind of store; None where there is none, or none that can be read."""
        try:
            return cls(**json.loads((folder / f"{kind}.json").read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            return None

    def write(self, folder: Path, kind: str = "mlflow") -> None:
        """Write the note, whole or not at all."""
        write_json(folder / f"{kind}.json", asdict(self))

    @staticmethod
    def remove(folder: Path, kind: str) -> None:
        """Take the note away."""
        (folder / f"{kind}.json").unlink(missing_ok=True)

"""What a tracking store already holds of a session's runs, by a key of ours: the seam that every tracker fills."""

from __future__ import annotations

import importlib
import json
from abc import ABC, abstractmethod
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from credit.runs.journal import write_json
from credit.tracking.entries import Entry, Upload
from credit.tracking.notes import Note
from credit.tracking.store import kind_of, name_in


class Ledger(ABC):
    """Uploads runs and remembers, in a file, what was uploaded.

    Args:
        file: the JSON file; one that belongs to another store is ignored.
        uri: resolved address of the store.
        output: output folder, for what lies in it, and the lock.
        session: the session's id; runs that a killed process had made for it are found again.
    """

    def __init__(self, file: Path, uri: str, output: Path, session: str):
        self._file, self._uri, self._output, self._session = file, uri, output, session
        self.sent = 0
        self.entries: dict[str, Entry] = {}
        # A file that a power cut emptied is no loss: the store is asked in any case.
        with suppress(OSError, ValueError, KeyError, TypeError):
            stored = json.loads(file.read_text())
            if self._is_mine(stored["uri"]):
                self.entries = {key: Entry(**entry | {"problem": None}) for key, entry in stored["runs"].items()}

    @abstractmethod
    def upload(self, run: Upload) -> None:
        """Bring one run up to date: create it, add rows beyond the last step, end it when its status says so.

        Raises:
            Exception: the store cannot be reached or written now, or answers nonsense; try again later.
        """

    def save(self, complete: object = None) -> None:
        """Write the file; `complete` says for which attempt of the session everything was uploaded."""
        runs = {key: asdict(entry) for key, entry in self.entries.items()}
        write_json(self._file, {"uri": name_in(self._output, self._uri), "complete": complete, "runs": runs})

    def forget(self, key: str) -> None:
        """Let go of a run: it is another session's, or the store lost it."""
        self.entries.pop(key, None)

    def _is_mine(self, uri: str) -> bool:
        return uri in (self._uri, name_in(self._output, self._uri))

    def _note(self, run: Upload) -> Note | None:
        """What the folder of a run says of it, where that is about this store."""
        note = Note.read(run.folder, kind_of(self._uri)) if run.folder else None
        return note if note and self._is_mine(note.uri) else None

    def _write_note(self, run: Upload, identity: str) -> None:
        if run.folder and run.folder.exists():
            note = Note(name_in(self._output, self._uri), self._session, run.key, identity)
            note.write(run.folder, kind_of(self._uri))


class Appending(Ledger):
    """For stores in which a run is a log, of rows behind rows.

    What a log holds, only the log knows for certain: it is read when a process takes the run up.
    """

    def __init__(self, file: Path, uri: str, output: Path, session: str):
        super().__init__(file, uri, output, session)
        self._open: set[str] = set()  # keys of the runs that this process has taken up

    @abstractmethod
    def begin(self, run: Upload, identity: str) -> int:
        """Make a run, or take it up; the last step that its log holds, −1 where it has none."""

    @abstractmethod
    def add(self, run: Upload, identity: str, after: int) -> int:
        """Append the rows beyond a step; the step of the last one that is there now."""

    @abstractmethod
    def end(self, run: Upload, identity: str) -> None:
        """Say how it ended."""

    def upload(self, run: Upload) -> None:
        """Bring one run up to date; a sweep has no curves of its own, and is no run here."""
        if run.card.tags["level"] == "sweep":
            self.entries[run.key] = Entry("", round(run.card.started * 1000), status=run.status)
            return
        entry = self.entries.get(run.key)
        if entry and run.key not in self._open and entry.status == run.status and not run.rows(entry.step):
            return
        try:
            self._bring(run)
        except Exception:
            self._open.discard(run.key)  # nobody knows how much of it is there
            raise

    def _bring(self, run: Upload) -> None:
        if run.key not in self._open:
            known, note = self.entries.get(run.key), self._note(run)
            identity = known.id if known else (note.run if note else "") or self.name(run)
            self._write_note(run, identity)
            step = self.begin(run, identity)
            rows = len(run.rows(-1)) - len(run.rows(step))
            started = round(run.card.started * 1000)
            self.entries[run.key] = Entry(identity, started, step=step, rows=rows)
            self._open.add(run.key)
        entry = self.entries[run.key]
        new = len(run.rows(entry.step))
        if new:
            entry.step = self.add(run, entry.id, entry.step)
            entry.rows, self.sent = entry.rows + new, self.sent + new
        if run.status != "RUNNING":
            self.end(run, entry.id)
            if run.status == "FINISHED" and run.folder:  # what is computed again is another run
                Note.remove(run.folder, kind_of(self._uri))
            self._open.discard(run.key)
        entry.status = run.status

    def name(self, run: Upload) -> str:
        """The identity of a run that nobody has begun: the same, whichever process asks."""
        number, _, seed = run.key.partition("/")
        return "/".join([run.experiment, self._session, number, *([f"seed-{seed}"] if seed else [])])


def ledger_of(file: Path, uri: str, output: Path, session: str) -> Ledger:
    """The ledger of a store: `open_ledger` of the module that is called as its kind.

    Args:
        file, uri, output, session: as `Ledger` has them.
    """
    module = importlib.import_module(f"credit.tracking.{kind_of(uri)}")
    opened: Ledger = module.open_ledger(file, uri, output, session)
    return opened

"""The sessions of an output folder: which live, what their stores still lack of them, how far their upload is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from credit.core.errors import UserError
from credit.runs.journal import read_json, write_json
from credit.runs.locks import Lock
from credit.tracking.store import STORE, born, kind_of, name_in, resolve_uri

Seeds = Literal["auto", "all", "none"]
PROGRESS_FILE = "tracking.json"


@dataclass(frozen=True)
class State:
    """How far the upload of a session is.

    Attributes:
        uri: resolved address of the store. seeds: which seeds get a run of their own.
        done: rows that the store has. total: rows in the journal. sent: rows sent by this uploader.
        problem: why it does not go on, or what was given up.
        since: when the store began to fail, epoch seconds; None while it works.
        ended: nothing more is tried.
    """

    uri: str
    seeds: Seeds
    done: int = 0
    total: int = 0
    sent: int = 0
    problem: str = ""
    since: float | None = None
    ended: bool = False

    @classmethod
    def read(cls, session: Path) -> State | None:
        """What the uploader of a session said last; None where it said nothing."""
        try:
            known = json.loads((session / PROGRESS_FILE).read_text(encoding="utf-8"))
            uri = None if known["uri"] == STORE else known["uri"]
            return cls(**known | {"uri": resolve_uri(uri, session.parents[1])})
        except (OSError, ValueError, TypeError, LookupError):
            return None

    def write(self, session: Path) -> None:
        """Say it; on a full disk nothing is said, since the upload matters more."""
        with suppress(OSError):
            write_json(session / PROGRESS_FILE, asdict(self) | {"uri": name_in(session.parents[1], self.uri)})


def read_session(session: Path) -> dict[str, Any]:
    """The record of a session.

    Raises:
        UserError: it is damaged.
    """
    return read_json(session / "session.json")


def attempt(session: dict[str, Any]) -> list[Any]:
    """What tells the attempts of one session apart: the process that runs it."""
    return [session["host"], session["pid"], session["process_started"]]


def lives(session: Path) -> bool:
    """Whether a command works on a session now: it holds the lock, which ends with it, however it ends."""
    try:
        return Lock(session / ".lock").held_elsewhere()
    except OSError:  # a file system without locks: leave alone what cannot be told
        return True


def all_sessions(output: Path) -> list[Path]:
    """The folders of the sessions in an output folder, oldest first."""
    return [file.parent for file in sorted(output.glob("sessions/*/session.json"))]


def store_of(session: Path, output: Path) -> tuple[str, Seeds] | None:
    """The resolved address of a session's store and its choice of seeds; None where it is not tracked.

    The folder's own store is where the folder is now; any other, where it was when the session began.
    """
    chosen = read_session(session)["tracking"]
    if chosen is None or "seeds" not in chosen:
        return None
    if (state := State.read(session)) is not None:
        return state.uri, state.seeds
    return (resolve_uri(chosen["uri"], output), chosen["seeds"]) if "uri" in chosen else None


def ledger_file(session: Path, uri: str) -> Path:
    """What a session remembers of a store."""
    return session / f"{kind_of(uri)}.json"


def pending(output: Path) -> Iterator[Path]:
    """Sessions that ended, or died, before their store was told everything."""
    for session in all_sessions(output):
        with suppress(OSError, ValueError, KeyError):  # a record that a full disk cut short is nobody's
            store = store_of(session, output)
            if store and not lives(session) and not _complete(session, store[0]):
                yield session


def damaged(output: Path) -> list[str]:
    """What is wrong with the records of sessions that cannot be read, of which nobody knows what is missing."""
    found = []
    for session in all_sessions(output):
        try:
            read_session(session)
        except UserError as error:
            found.append(str(error))
    return found


def lacking(output: Path) -> Iterator[Path]:
    """Sessions with runs that their store refused, so that it does not have everything of them."""
    for session in all_sessions(output):
        with suppress(OSError, ValueError, KeyError):
            store = store_of(session, output)
            if store is None:
                continue
            ledger = json.loads(ledger_file(session, store[0]).read_text(encoding="utf-8"))
            refused = any(entry["problem"] for entry in ledger["runs"].values())
            if refused and not lives(session) and _complete(session, store[0]):
                yield session


def _complete(session: Path, uri: str) -> bool:
    """Whether a store was told everything, and is still the one that was told."""
    file = ledger_file(session, uri)
    try:
        ledger, told = json.loads(file.read_text(encoding="utf-8")), file.stat().st_mtime
    except (OSError, ValueError):
        return False
    return bool(ledger["complete"] == attempt(read_session(session))) and born(uri) <= told

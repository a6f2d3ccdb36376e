"""Runs in Weights & Biases: one for every job and seed, in a group for each session; without a network at first."""

from __future__ import annotations

import hashlib
import os
import shlex
import struct
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, Literal
from urllib.parse import parse_qs, urlencode
from urllib.request import pathname2url

from credit.tracking.entries import Upload
from credit.tracking.ledger import Appending, Ledger
from credit.tracking.mirrored import Mirrored
from credit.tracking.sessions import Seeds
from credit.tracking.store import folder_of, resolve_uri

_QUIET = {"WANDB_SILENT": "true", "WANDB_ERROR_REPORTING": "false"}
SETTLED = 1.0  # seconds in which a file does not grow whose service has died
PATIENCE = 60.0  # seconds for the end of a run that was finished
_BLOCK = 32768  # bytes, in which a file of wandb's is written


class WandbTracking(Mirrored):
    """Mirrors the journal to Weights & Biases.

    Args:
        project: the project. entity: a user or a team; None is wandb's default.
        mode: `offline` writes to `wandb` in the output folder, which `wandb sync` uploads; `online` uploads at once.
        seeds: as in `Mirrored`.
    """

    title, package = "Weights & Biases", "wandb"

    def __init__(
        self,
        project: str = "credit",
        entity: str | None = None,
        mode: Literal["offline", "online"] = "offline",
        seeds: Seeds = "auto",
    ):
        super().__init__(seeds)
        self.project, self.entity, self.mode = project, entity, mode

    def address(self, output: Path) -> str:
        """`wandb:FOLDER?project=…&mode=…`."""
        options = {"project": self.project, "mode": self.mode} | ({"entity": self.entity} if self.entity else {})
        return resolve_uri(f"{self.package}:{pathname2url(self.package)}?{urlencode(options)}", output)

    def look(self, output: Path) -> str | None:
        """The upload, where that is still to be done."""
        return f"wandb sync {shlex.quote(str(output / 'wandb'))}/offline-run-*" if self.mode == "offline" else None


class WandbLedger(Appending):
    """One run of wandb's for each of ours, by an identity that every process finds again."""

    def __init__(self, file: Path, uri: str, output: Path, session: str):
        super().__init__(file, uri, output, session)
        self._folder = folder_of(uri)
        options = parse_qs(uri.partition("?")[2])
        self._options: dict[str, Any] = {name: values[0] for name, values in options.items()}
        self._runs: dict[str, Any] = {}

    def name(self, run: Upload) -> str:
        """Few letters, as wandb has them."""
        return hashlib.sha256(super().name(run).encode()).hexdigest()[:16]

    def begin(self, run: Upload, identity: str) -> int:
        """The last step that the server, or a file here, holds."""
        os.environ.update(_QUIET)
        import wandb

        self.forget_open(run.key)
        here = self._steps(identity)
        while list(self._folder.glob(f"*run-{datetime.now():%Y%m%d_%H%M%S}-{identity}")):
            time.sleep(0.05)  # folders are named by the second, and a second run in it would write over the first
        self._folder.mkdir(parents=True, exist_ok=True)
        tags, card = run.card.tags, run.card
        opened = self._runs[run.key] = wandb.init(
            **self._options,
            dir=self._folder.parent,
            id=identity,
            name=f"{card.job} {card.name}".strip(),
            group=tags["session"],
            job_type=tags["level"],
            tags=[run.experiment, tags["method"]],
            notes=card.description,
            config=card.params,
            resume="allow",
            reinit="create_new",
            settings=wandb.Settings(silent=True, console="off", x_disable_stats=True, disable_git=True),
        )
        return max([opened.starting_step - 1, *here])

    def add(self, run: Upload, identity: str, after: int) -> int:
        """A row a step."""
        rows = run.rows(after)
        for row in rows:
            self._runs[run.key].log(row.values, step=row.step, commit=True)
        return rows[-1].step

    def end(self, run: Upload, identity: str) -> None:
        """Keep its files, and say whether it went well."""
        for file in run.files:
            self._runs[run.key].save(str(file), base_path=str(file.parent), policy="now")
        self._close(run.key, int(run.status != "FINISHED"))

    def forget_open(self, key: str) -> None:
        """Close what was open: nobody knows how much of it is there."""
        if key in self._runs:
            self._close(key, 1)

    def _close(self, key: str, code: int) -> None:
        """End a run of wandb's, and wait until its file is whole: its service writes the last of it afterwards."""
        run = self._runs.pop(key)
        run.finish(exit_code=code)
        newest = max(self._files(run.id), default=None)
        until = time.monotonic() + PATIENCE
        while newest is not None and not _read(newest)[1] and time.monotonic() < until:
            time.sleep(0.05)  # a busy machine writes the end late, and nothing before it tells that it will come

    def _files(self, identity: str) -> list[Path]:
        """The logs of a run: their folders are named by time."""
        return sorted(self._folder.glob(f"*run-*-{identity}/*.wandb"))

    def _steps(self, identity: str) -> list[int]:
        """The steps in the files of a run, once nobody writes there: at their ends, or where they do not grow."""
        found: list[int] = []
        for file in self._files(identity):
            size, steps, ended = -1, list[int](), False
            while not ended and file.stat().st_size != size:
                if size >= 0:
                    time.sleep(SETTLED)
                size = file.stat().st_size
                steps, ended = _read(file)
            found += steps
        return found


def _read(file: Path) -> tuple[list[int], bool]:
    """The steps in a file of wandb's, as far as it was written, and whether its run ends in it."""
    from wandb.proto.wandb_internal_pb2 import Record

    records = [Record.FromString(content) for content in _records(file.read_bytes())]
    steps = [record.history.step.num for record in records if record.HasField("history")]
    return steps, any(record.HasField("exit") for record in records)


def _records(data: bytes) -> Iterator[bytes]:
    """The records of a log in LevelDB's format: parts in blocks, each behind a check, its length and its kind."""
    place, whole = 7, b""
    while place + 7 <= len(data):
        if (left := _BLOCK - place % _BLOCK) < 7:
            place += left
            continue
        length, kind = struct.unpack_from("<HB", data, place + 4)
        part = data[place + 7 : place + 7 + length]
        if not kind or len(part) < length:
            return
        place += 7 + length
        whole = part if kind in (1, 2) else whole + part  # whole, first; middle, last
        if kind in (1, 4):
            yield whole


def open_ledger(file: Path, uri: str, output: Path, session: str) -> Ledger:
    """What Weights & Biases holds of a session; arguments as `Ledger` has them."""
    return WandbLedger(file, uri, output, session)

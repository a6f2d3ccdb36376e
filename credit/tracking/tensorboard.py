"""Runs in TensorBoard: a file of events for every job and seed, with a row of the journal in each event."""

from __future__ import annotations

import re
import shlex
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.request import pathname2url

from credit.core.naming import LONGEST
from credit.tracking.curves import Row
from credit.tracking.entries import Upload
from credit.tracking.ledger import Appending, Ledger
from credit.tracking.mirrored import Mirrored
from credit.tracking.sessions import Seeds
from credit.tracking.store import folder_of, resolve_uri

if TYPE_CHECKING:
    from tensorboard.compat.proto.event_pb2 import Event


class TensorBoardTracking(Mirrored):
    """Mirrors the journal to a folder that `tensorboard --logdir` shows.

    Args:
        folder: of the events; None is `tensorboard` in the output folder, in which one that is not absolute lies, too.
        seeds: as in `Mirrored`.
    """

    title, package = "TensorBoard", "tensorboard"

    def __init__(self, folder: str | None = None, seeds: Seeds = "auto"):
        super().__init__(seeds)
        self.folder = folder or self.package

    def address(self, output: Path) -> str:
        """`tensorboard:FOLDER`."""
        return resolve_uri(f"{self.package}:{pathname2url(self.folder)}", output)

    def look(self, output: Path) -> str:
        """TensorBoard's own command."""
        return shlex.join(["tensorboard", "--logdir", str(output / self.folder)])


class TensorBoardLedger(Appending):
    """One file of events a run, which only grows."""

    def name(self, run: Upload) -> str:
        """A folder that is called as the job is, since TensorBoard shows folders; its seeds stand beside it."""
        number, _, seed = run.key.partition("/")
        job = re.sub(r"[^\w.=,+-]+", " ", run.card.job or run.card.name)[:LONGEST]
        return f"{run.experiment}/{self._session}/{number} {job}{f' {run.card.name}' if seed else ''}"

    def begin(self, run: Upload, identity: str) -> int:
        """The last step in the file; what a kill cut short behind it is cut off."""
        from tensorboard.compat.proto.event_pb2 import Event

        file, last, end = self._file_of(run, identity), -1, 0
        file.parent.mkdir(parents=True, exist_ok=True)
        data = file.read_bytes() if file.exists() else b""
        while end + 12 <= len(data):
            behind = end + 16 + struct.unpack_from("<Q", data, end)[0]  # a length, its check, the event, its check
            if behind > len(data):
                break
            event = Event.FromString(data[end + 12 : behind - 4])
            is_row = any(value.HasField("simple_value") for value in event.summary.value)
            last, end = event.step if is_row else last, behind
        if end < len(data):
            with file.open("rb+") as handle:
                handle.truncate(end)
        if not end:
            self._append(run, identity, [Event(file_version="brain.Event:2"), *_description(run)])
        return last

    def add(self, run: Upload, identity: str, after: int) -> int:
        """Each row is an event, whole or not there."""
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.compat.proto.summary_pb2 import Summary

        def event(row: Row) -> Event:
            values = [Summary.Value(tag=name, simple_value=value) for name, value in row.values.items()]
            return Event(wall_time=run.card.started + row.seconds, step=row.step, summary=Summary(value=values))

        rows = run.rows(after)
        self._append(run, identity, map(event, rows))
        return rows[-1].step

    def _append(self, run: Upload, identity: str, events: Iterable[Event]) -> None:
        from tensorboard.summary.writer.record_writer import RecordWriter

        with self._file_of(run, identity).open("ab") as handle:
            writer = RecordWriter(handle)
            for event in events:
                writer.write(event.SerializeToString())

    def _file_of(self, run: Upload, identity: str) -> Path:
        return folder_of(self._uri) / identity / "events.out.tfevents.credit"

    def end(self, run: Upload, identity: str) -> None:
        """A file of events has no end."""


def _description(run: Upload) -> Iterator[Event]:
    """What a run is: a text, and what tells it from the other jobs, for the table of hyperparameters."""
    from tensorboard.compat.proto.event_pb2 import Event
    from tensorboard.compat.proto.summary_pb2 import Summary
    from tensorboard.compat.proto.tensor_pb2 import TensorProto
    from tensorboard.compat.proto.types_pb2 import DT_STRING
    from tensorboard.plugins.hparams.summary_v2 import hparams_pb
    from tensorboard.plugins.text.metadata import create_summary_metadata

    told = TensorProto(dtype=DT_STRING, string_val=[run.card.description.encode()])
    text = Summary.Value(tag="description", tensor=told, metadata=create_summary_metadata("", ""))
    yield Event(wall_time=run.card.started, summary=Summary(value=[text]))
    if run.card.tags["level"] == "job":
        values = hparams_pb(run.card.differing, trial_id=run.card.name, start_time_secs=run.card.started)
        yield Event(wall_time=run.card.started, summary=values)


def open_ledger(file: Path, uri: str, output: Path, session: str) -> Ledger:
    """What TensorBoard holds of a session; arguments as `Ledger` has them."""
    return TensorBoardLedger(file, uri, output, session)

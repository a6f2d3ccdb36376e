"""Where a table lies: a frame in memory, or files that are read in chunks."""

from __future__ import annotations

import glob
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError, nearest
from credit.logged.panel import Ints

if TYPE_CHECKING:
    import pandas as pd

CHUNK = 1_000_000  # rows that are looked at together
SAMPLE, PIECES = 200_000, 8  # rows from which roles are guessed, in so many pieces of neighbours
MEMORY = 512 * 2**20  # bytes of a table that is held in memory whole; larger ones are read in chunks
CSV, PARQUET = (".csv", ".tsv", ".txt"), (".parquet", ".pq")
IN_FOLDERS = (".csv", ".tsv", ".parquet", ".pq")  # what lies in a folder beside tables is often text
MAGIC = {b"PAR1": "Parquet", b"PK\x03\x04": "an Excel or ZIP file", b"\x1f\x8b": "packed by gzip", b"\x89HDF": "HDF5"}


class Source(ABC):
    """A table that can be read more than once.

    Attributes:
        name: for messages. columns: their names. rows: how many. said: what was done to read it.
    """

    name: str
    columns: tuple[str, ...]
    rows: int
    said: tuple[str, ...] = ()

    @abstractmethod
    def chunks(self, columns: Sequence[str], least: int | None = None) -> Iterator[tuple[pd.DataFrame, Ints]]:
        """Rows in order, some of the columns, with the rows' numbers in what was given; `CHUNK` or so many at once."""

    @abstractmethod
    def sample(self) -> pd.DataFrame:
        """Some stretches of rows with all columns."""

    def pieces(self) -> list[Source]:
        """The same as several tables, one after the other, where it lies in several files."""
        return [self]

    def whole(self, columns: Sequence[str]) -> tuple[pd.DataFrame, Ints]:
        """All rows at once, with their numbers."""
        import pandas as pd

        chunks = [*self.chunks(columns)]
        return pd.concat([frame for frame, _ in chunks], ignore_index=True), np.concatenate(
            [rows for _, rows in chunks]
        )

    def bytes(self, columns: int) -> int:
        """About how much memory so many of its columns take."""
        return self.rows * columns * 8


class FrameSource(Source):
    """A table in memory. What has no file of its own (runs, other formats) comes in as one, too.

    Args:
        frame: names of columns are made strings. name: for messages. rows: their numbers, where they are not 0, 1, ….
    """

    def __init__(self, frame: pd.DataFrame, name: str, rows: Ints | None = None, said: tuple[str, ...] = ()) -> None:
        if getattr(frame.columns, "nlevels", 1) > 1:
            raise UserError(f"{name}: its columns have several levels of names; give each column one name")
        columns = [str(column) for column in frame.columns]
        twice = next((column for column in columns if columns.count(column) > 1), None)
        if twice is not None:
            raise UserError(f"{name}: two columns are called {twice!r}; rename one")
        self.frame = frame.set_axis(columns, axis=1)
        self.name, self.columns, self.rows, self.said = name, tuple(columns), len(frame), said
        self.numbers = np.arange(len(frame)) if rows is None else rows

    def chunks(self, columns: Sequence[str], least: int | None = None) -> Iterator[tuple[pd.DataFrame, Ints]]:
        """Slices of it."""
        frame, least = self.frame[[*columns]], least or CHUNK
        for first in range(0, len(frame), least):
            yield (
                frame.iloc[first : first + least].reset_index(drop=True),
                self.numbers[first : first + least],
            )

    def sample(self) -> pd.DataFrame:
        """Some stretches of rows."""
        if self.rows <= SAMPLE:
            return self.frame.reset_index(drop=True)
        at = stretches(self.rows)
        return self.frame.iloc[at].reset_index(drop=True)

    def whole(self, columns: Sequence[str]) -> tuple[pd.DataFrame, Ints]:
        """It, without a copy."""
        return self.frame[[*columns]].reset_index(drop=True), self.numbers


def stretches(rows: int) -> Ints:
    """Numbers of rows of a sample: `PIECES` stretches of neighbours, evenly spread."""
    length = SAMPLE // PIECES
    return np.concatenate([np.arange(length) + first for first in np.linspace(0, rows - length, PIECES).astype(int)])


def located(data: Any, memory: int = MEMORY) -> Source:
    """What a user gave, as a source: a frame, a path, a pattern, a folder, a list of paths; or one already.

    Raises:
        UserError: there is nothing, or no table.
    """
    if isinstance(data, Source):
        return data
    if hasattr(data, "iloc") and hasattr(data, "columns"):
        if not len(data):
            raise UserError("the frame has no rows; give one row a step")
        unnamed = any(name is None or name in data.columns for name in data.index.names)
        return FrameSource(data if unnamed else data.reset_index(), "the frame")
    paths = files(data)
    found = _read(paths, memory)
    if skipped := _skipped(data):
        found.said = (*found.said, skipped)
    return found


def _read(paths: Sequence[Path], memory: int) -> Source:
    name = str(paths[0]) if len(paths) == 1 else f"{paths[0].parent} ({len(paths)} files)"
    for path in paths:
        kind = "CSV" if _suffix(path) in CSV else "Parquet"
        _begins(path, kind)
    if _suffix(paths[0]) in CSV:
        from credit.logged.tables import csvs

        return csvs.opened(paths, name, memory)
    from credit.logged.tables import parquets

    source = parquets.ParquetSource(paths, name)
    if source.bytes(len(source.columns)) > memory:
        return source
    frame, rows = source.whole(source.columns)
    return FrameSource(frame, name, rows)


def files(data: Any) -> list[Path]:
    """The files that are meant, by name.

    Raises:
        UserError: none, or of several kinds.
    """
    if isinstance(data, list | tuple):
        found = [path for item in data for path in files(item)]
        if not found:
            raise UserError("the list of files is empty; give at least one")
    elif not isinstance(data, str | Path):
        shown = repr(data) if len(repr(data)) <= 60 else f"{repr(data)[:57]}..."
        raise UserError(
            f"{shown} ({type(data).__name__}) is no table; give a path (a file, a folder, a pattern), a list of paths, "
            "or a pandas DataFrame"
        )
    else:
        found = _matching(str(data))
    kinds = {_suffix(path) in CSV for path in found}
    if len(kinds) > 1:
        raise UserError(f"{data}: there are CSV and Parquet files among them; give one kind")
    return found


def _matching(text: str) -> list[Path]:
    path = Path(text).expanduser()
    if path.is_dir():
        every = sorted(item for item in path.rglob("*") if item.is_file() and not _hidden(item, path))
        found = [item for item in every if _suffix(item) in IN_FOLDERS]
        if not found:
            raise UserError(
                f"{text}: no file in this folder ends in one of {', '.join(IN_FOLDERS)}; text that is a table is given "
                "by its name, or by a pattern (FOLDER/*.txt)"
            )
        return found
    if path.is_file():
        if _suffix(path) not in CSV + PARQUET:
            raise UserError(f"{text}: tables end in one of {', '.join(CSV + PARQUET)}; rename it, or convert it")
        return [path]
    found = sorted(Path(item) for item in glob.glob(str(path), recursive=True) if Path(item).is_file())
    if not found:
        beside = [item.name for item in path.parent.glob("*") if _suffix(item) in CSV + PARQUET]
        if not path.parent.is_dir():
            raise UserError(f"{text}: there is no folder {path.parent}; give the path of a table")
        near = nearest(path.name, beside) if beside else f"no table lies in {path.parent}"
        raise UserError(f"{text}: there is no such file; {near}")
    for item in found:
        if _suffix(item) not in CSV + PARQUET:
            raise UserError(f"{item}: tables end in one of {', '.join(CSV + PARQUET)}; narrow the pattern")
    return found


def _skipped(data: Any) -> str:
    """Which files of a folder are not read, in a sentence; "" where there are none."""
    folder = Path(data).expanduser() if isinstance(data, str | Path) else None
    if folder is None or not folder.is_dir():
        return ""
    every = [item for item in folder.rglob("*") if item.is_file() and not _hidden(item, folder)]
    others = sorted(str(item.relative_to(folder)) for item in every if _suffix(item) not in IN_FOLDERS)
    more = f", and {len(others) - 3} more" if len(others) > 3 else ""
    ends = ", ".join(IN_FOLDERS)
    return f"files that do not end in {ends} were skipped: {', '.join(others[:3])}{more}" if others else ""


def _hidden(item: Path, folder: Path) -> bool:
    return any(part.startswith((".", "_")) for part in item.relative_to(folder).parts)


def _suffix(path: Path) -> str:
    return path.suffix.lower()


def _begins(path: Path, kind: str) -> None:
    """Refuse a file that is not what its name's ending says."""
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from None
    if not head:
        raise UserError(f"{path} is empty (0 bytes); was it written to its end?")
    found = next((what for magic, what in MAGIC.items() if head.startswith(magic)), None)
    if kind == "Parquet" and found != "Parquet":
        what = found or ("text" if b"\0" not in head else "something else")
        raise UserError(f"{path} ends in {path.suffix}, but it is {what}; rename it, or convert it to Parquet")
    if kind == "CSV" and found:
        raise UserError(f"{path} ends in {path.suffix}, but it is {found}; rename it, or convert it to CSV")
    if kind == "CSV" and head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UserError(f"{path} is written in UTF-16 (its first byte is 0x{head[0]:02x}); save it as UTF-8")
    if kind == "CSV" and b"\0" in head:
        raise UserError(f"{path} ends in {path.suffix}, but it is no text (byte {head.index(0)} is 0)")

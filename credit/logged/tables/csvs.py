"""CSV files: their dialect is found, their faults are named; large ones become Parquet in a temporary folder."""

from __future__ import annotations

import codecs
import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.core.errors import UserError
from credit.logged.tables.sources import FrameSource, Source

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

BLOCK = 32 * 2**20  # bytes of a large file that are read at once
NULLS = ("", "NA", "N/A", "n/a", "NaN", "nan", "NULL", "null", "None", "#N/A", "<NA>")


@dataclass(frozen=True)
class Dialect:
    """How a file separates.

    Attributes:
        separator: of columns. decimal: of numbers.
    """

    separator: str = ","
    decimal: str = "."


def opened(paths: Sequence[Path], name: str, memory: int) -> Source:
    """One table of CSV files.

    Raises:
        UserError: a file that is no table of text in UTF-8.
    """
    import pandas as pd

    dialects = [dialect(path) for path in paths]
    odd = next((item for item in dialects if item != Dialect()), None)
    said = (f"columns are separated by {odd.separator!r}, decimals by {odd.decimal!r}",) if odd else ()
    if sum(path.stat().st_size for path in paths) > memory:
        return _converted(paths, dialects, name, said)
    frames = [_frame(path, how) for path, how in zip(paths, dialects, strict=True)]
    for path, frame in zip(paths, frames, strict=True):
        alike(path, [*frame.columns], paths[0], [*frames[0].columns])
    frame = frames[0] if len(frames) == 1 else pd.concat(frames, ignore_index=True)
    if not len(frame):
        raise UserError(f"{name}: there are no rows in it, only the names of columns; give one row a step")
    return FrameSource(frame, name, said=said)


def dialect(path: Path) -> Dialect:
    """The separator that splits the first lines alike, and what stands before decimals.

    Raises:
        UserError: names of columns that are missing or not unique.
    """
    with path.open("rb") as stream:
        head = stream.read(65536).decode("utf-8", errors="replace").removeprefix("\ufeff")
    lines = [line for line in head.splitlines() if line.strip()][:50]
    if not lines:
        raise UserError(f"{path}: there is nothing in it but blank lines; the first line must name the columns")
    separator = max(",;\t|", key=lambda mark: (lines[0].count(mark), mark == ","))
    names = next(csv.reader(lines[:1], delimiter=separator))
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"{path}: two columns are called {twice!r}; rename one")
    if len(names) > 1 and all(re.fullmatch(r"\s*-?\d+([.,]\d+)?\s*", name) for name in names):
        raise UserError(f"{path}: the first line holds numbers ({lines[0][:60]}); it must name the columns")
    comma = separator != "," and any(re.search(r"(^|[;\t|])-?\d+,\d+([;\t|]|$)", line) for line in lines[1:])
    return Dialect(separator, "," if comma else ".")


def alike(path: Path, columns: Sequence[Any], first: Path, others: Sequence[Any]) -> None:
    """Refuse files of one table with different columns."""
    missing, more = [name for name in others if name not in columns], [name for name in columns if name not in others]
    if missing:
        raise UserError(f"{path}: there is no column {missing[0]!r}, which {first} has; files of a table are alike")
    if more:
        raise UserError(
            f"{path}: there is a column {more[0]!r}, which {first} does not have; files of a table are alike"
        )


def _frame(path: Path, how: Dialect) -> pd.DataFrame:
    import pandas as pd

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # a row that is longer than the names
            return pd.read_csv(path, sep=how.separator, decimal=how.decimal, low_memory=False, index_col=False)
    except UnicodeDecodeError:
        raise encoding(path) from None
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning, OSError, ValueError) as error:
        raise broken(path, error) from None


def encoding(path: Path) -> UserError:
    """Which byte is not UTF-8, and where."""
    decoder, lines, seen = codecs.getincrementaldecoder("utf-8")(), 1, 0
    with path.open("rb") as stream:
        while block := stream.read(2**20):
            held = len(decoder.getstate()[0])
            try:
                lines += decoder.decode(block).count("\n")
            except UnicodeDecodeError as error:
                lines += error.object[: error.start].count(b"\n")
                at = seen - held + error.start
                return UserError(
                    f"{path} is not written in UTF-8: byte {at} (line {lines}) is 0x{error.object[error.start]:02x}; "
                    f"save it as UTF-8, for example by: iconv -f latin1 -t utf-8"
                )
            seen += len(block)
    return UserError(f"{path} ends within a letter in UTF-8; was it written to its end?")


def broken(path: Path, error: Exception) -> UserError:
    """What a reader said of a file, in a line."""
    what = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return UserError(f"{path} cannot be read as a table ({what}); every line must have as many values as the first")


def _converted(paths: Sequence[Path], dialects: Sequence[Dialect], name: str, said: tuple[str, ...]) -> Source:
    """The same as Parquet files, which can be read in chunks and by columns."""
    from credit.logged.tables.parquets import ParquetSource, Workplace

    place = Workplace()
    types: dict[str, str] = {}
    with place.writing(name):
        while (wider := _attempt(paths, dialects, place.folder, types)) is not None:
            types |= wider
    source = ParquetSource([place.folder / f"{i:05d}.parquet" for i in range(len(paths))], name, place)
    source.said = (*said, "it is large, and so it was converted to Parquet in a temporary folder first")
    return source


def _attempt(
    paths: Sequence[Path], dialects: Sequence[Dialect], folder: Path, types: dict[str, str]
) -> dict[str, str] | None:
    """Convert all; what type a column must have, where values further down did not fit; None: done.

    Types are guessed from a file's first block: a column that begins with whole numbers may go on with others.
    """
    import pyarrow as pa
    import pyarrow.csv as reader
    import pyarrow.parquet as pq

    seen: dict[str, pa.DataType] = {}
    for i, (path, how) in enumerate(zip(paths, dialects, strict=True)):
        convert = reader.ConvertOptions(
            column_types={column: pa.type_for_alias(kind) for column, kind in types.items()},
            null_values=NULLS, strings_can_be_null=True, decimal_point=how.decimal,
        )  # fmt: skip
        read = reader.ReadOptions(block_size=BLOCK)
        try:
            parse = reader.ParseOptions(delimiter=how.separator, newlines_in_values=True)
            with reader.open_csv(path, read, parse, convert) as stream:
                alike(path, stream.schema.names, paths[0], [*seen] or stream.schema.names)
                if any(pa.types.is_binary(kind) for kind in stream.schema.types):  # what is no text is taken as that
                    raise encoding(path)
                for column in stream.schema:
                    if (other := seen.setdefault(column.name, column.type)) != column.type:
                        return {column.name: _both(other, column.type)}
                with pq.ParquetWriter(folder / f"{i:05d}.parquet", stream.schema) as writer:
                    for batch in stream:
                        if batch.num_rows:
                            writer.write_batch(batch)
        except pa.ArrowInvalid as error:
            misfit = re.search(r"In CSV column #(\d+): .*conversion error to ([\w\[\], ]+):", str(error))
            if misfit and "UTF8" not in str(error):
                column = stream.schema.names[int(misfit[1])]
                return {column: "double" if misfit[2].startswith("int") else "string"}
            raise (encoding(path) if "UTF8" in str(error) else broken(path, error)) from None
    return None


def _both(one: pa.DataType, other: pa.DataType) -> str:
    import pyarrow.types as of

    numbers = all(of.is_integer(kind) or of.is_floating(kind) or of.is_null(kind) for kind in (one, other))
    return "double" if numbers else "string"

"""Parquet files, read in chunks by pyarrow, and sorted by DuckDB where they are not in order."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Ints
from credit.logged.tables import sources
from credit.logged.tables.sources import PIECES, SAMPLE, Source

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.dataset as ds

BATCH = 131_072  # rows that pyarrow decodes at once
SORTING = 2 * 2**30  # bytes that DuckDB may use before it spills
ROW = "__row"  # the number of a row in what was given, in a file that we wrote
KEYS = ("__group", "__time", ROW)


class Workplace:
    """A temporary folder that goes with whoever holds it, or when Python ends."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="credit-"))
        self._gone = weakref.finalize(self, shutil.rmtree, self.folder, True)

    @contextmanager
    def writing(self, name: str) -> Iterator[None]:
        """What is written here; nothing stays where that fails.

        Raises:
            UserError: no room on the disk.
        """
        try:
            yield
        except OSError as error:
            self._gone()
            raise UserError(
                f"{name}: a temporary copy in {self.folder.parent} failed ({error}); give it room, or set TMPDIR"
            ) from None
        except BaseException:
            self._gone()
            raise


class ParquetSource(Source):
    """Parquet files that are one table; `key=value` in their folders' names is a column.

    Args:
        paths: in order. name: for messages. place: what holds the files, where they are temporary. first: number of the
            first row.
    """

    def __init__(self, paths: Sequence[Path], name: str, place: Workplace | None = None, first: int = 0) -> None:
        self.name, self._paths, self._place, self._first = name, [*paths], place, first
        self._data = _dataset(self._paths)
        names = self._data.schema.names
        twice = next((column for column in names if names.count(column) > 1), None)
        if twice is not None:
            raise UserError(f"{name}: two columns are called {twice!r}; rename one")
        self.columns = tuple(column for column in names if column not in KEYS)
        self._numbered = ROW in names
        self.rows = self._data.count_rows()
        if not self.rows:
            raise UserError(f"{name}: there are no rows in it, only the names of columns; give one row a step")

    def pieces(self) -> list[Source]:
        """Its files, where they are those that were given."""
        if self._place is not None or len(self._paths) == 1:
            return [self]
        found: list[Source] = []
        first = self._first
        for path in self._paths:
            found.append(ParquetSource([path.resolve()], str(path), first=first))
            first += found[-1].rows
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        return ParquetSource, (self._paths, self.name, None, self._first)

    def tables(self, columns: Sequence[str], least: int | None = None) -> Iterator[tuple[pa.Table, Ints]]:
        """Rows in order, as pyarrow has them, with their numbers."""
        import pyarrow as pa
        import pyarrow.dataset as ds

        wanted = [*columns, ROW] if self._numbered else [*columns]
        least = least or sources.CHUNK
        held: list[pa.RecordBatch] = []
        first = count = 0
        options = ds.ParquetFragmentScanOptions(pre_buffer=False)  # which would hold the whole file
        batches = self._data.to_batches(
            columns=wanted,
            batch_size=min(BATCH, least),
            batch_readahead=2,
            fragment_readahead=1,
            fragment_scan_options=options,
        )
        for batch in self._safely(batches):
            held.append(batch)
            count += batch.num_rows
            if count >= least:
                yield self._numbers(pa.Table.from_batches(held), first)
                first, held, count = first + count, [], 0
        if count:
            yield self._numbers(pa.Table.from_batches(held), first)

    def chunks(self, columns: Sequence[str], least: int | None = None) -> Iterator[tuple[pd.DataFrame, Ints]]:
        """The same as frames."""
        for table, rows in self.tables(columns, least):
            yield plain(table).to_pandas(split_blocks=True), rows

    def sample(self) -> pd.DataFrame:
        """The beginnings of some row groups, or all where there are few rows."""
        import pyarrow as pa
        import pyarrow.dataset as ds

        columns = [*self.columns]
        if self.rows <= SAMPLE:
            return self.whole(columns)[0]
        fragments = [*self._safely(part for item in self._data.get_fragments() for part in item.split_by_row_group())]
        chosen = [fragments[i] for i in np.unique(np.linspace(0, len(fragments) - 1, PIECES).astype(int))]
        length = SAMPLE // len(chosen)
        schema = self._data.schema
        how = {"fragment_scan_options": ds.ParquetFragmentScanOptions(pre_buffer=False), "batch_readahead": 0}
        scans = (part.scanner(schema=schema, columns=columns, batch_size=length, **how).head(length) for part in chosen)
        return plain(pa.concat_tables(self._safely(scans))).to_pandas()

    def _numbers(self, table: pa.Table, first: int) -> tuple[pa.Table, Ints]:
        if self._numbered:
            return table.drop_columns([ROW]), table[ROW].to_numpy()
        return table, np.arange(first, first + table.num_rows) + self._first

    def _safely(self, items: Any) -> Iterator[Any]:
        """Items, with a damaged page said as such."""
        import pyarrow as pa

        try:
            yield from items
        except (pa.ArrowException, OSError) as error:
            raise _damaged(self.name, error) from None


def plain(table: pa.Table) -> pa.Table:
    """The same with dates as times, and decimals and bits as numbers: what pandas knows as objects."""
    import pyarrow as pa
    import pyarrow.types as of

    for i, column in enumerate(table.schema):
        kind = column.type
        to = None
        if of.is_date(kind):
            to = pa.timestamp("us")
        elif of.is_decimal(kind):
            to = pa.float64()
        elif of.is_boolean(kind) and table[i].null_count:
            to = pa.int8()
        if to is not None:
            table = table.set_column(i, column.name, table[i].cast(to))
    return table


def by_duckdb(source: ParquetSource, columns: Sequence[str], keys: Callable[..., Any], memory: int) -> ParquetSource:
    """A sorted copy in a temporary folder, by a sort that spills to disk.

    Args:
        keys: frame, rows → numbers of the groups, times, by which (and by rows, last) they are sorted.

    Raises:
        ImportError: there is no DuckDB. UserError: no room.
    """
    import duckdb
    import pyarrow as pa

    place = Workplace()
    failed: list[UserError] = []

    def batches(schema: pa.Schema) -> Iterator[pa.RecordBatch]:
        try:
            for table, rows in source.tables(columns):
                group, time = keys(plain(table).to_pandas(), rows)
                for name, values in zip(KEYS, (group, time, rows), strict=True):
                    table = table.append_column(name, pa.array(values))
                yield from table.cast(schema).to_batches()
        except UserError as error:  # DuckDB would wrap it
            failed.append(error)
            raise

    schema = source._data.schema
    fields = [schema.field(column) for column in columns]
    fields = [
        pa.field(item.name, item.type.value_type if pa.types.is_dictionary(item.type) else item.type) for item in fields
    ]  # no dictionaries
    tail = [pa.field("__group", pa.int64()), pa.field("__time", pa.float64()), pa.field(ROW, pa.int64())]
    with place.writing(source.name), duckdb.connect() as connection:
        connection.execute(f"SET memory_limit = '{max(memory, SORTING) // 2**20}MiB'")
        connection.execute("SET enable_progress_bar = false")
        connection.execute(f"SET temp_directory = '{place.folder}'")
        reader = pa.RecordBatchReader.from_batches(pa.schema([*fields, *tail]), batches(pa.schema([*fields, *tail])))
        connection.register("rows", reader)
        kept = ", ".join('"' + name.replace('"', '""') + '"' for name in [*columns, ROW])
        order = ", ".join(f'"{name}"' for name in KEYS)
        target = place.folder / "sorted.parquet"
        try:
            connection.execute(f"COPY (SELECT {kept} FROM rows ORDER BY {order}) TO '{target}' (FORMAT parquet)")
        except duckdb.Error as error:
            if failed:
                raise failed[0] from None
            raise OSError(str(error).splitlines()[0]) from None
    return ParquetSource([target], source.name, place)


def _dataset(paths: Sequence[Path]) -> ds.Dataset:
    import pyarrow as pa
    import pyarrow.dataset as ds
    import pyarrow.parquet as pq

    schemas: list[pa.Schema] = []
    for path in paths:
        try:
            schemas.append(pq.read_schema(path).remove_metadata())
        except (pa.ArrowException, OSError) as error:
            raise _damaged(str(path), error) from None
        missing = [name for name in schemas[0].names if name not in schemas[-1].names]
        if missing:
            raise UserError(
                f"{path}: there is no column {missing[0]!r}, which {paths[0]} has; files of a table are alike"
            )
    try:
        data = ds.dataset([str(path) for path in paths], format="parquet", partitioning="hive")
        whole = pa.unify_schemas([*schemas, data.schema.remove_metadata()], promote_options="permissive")
        return ds.dataset([str(path) for path in paths], whole, format="parquet", partitioning="hive")
    except pa.ArrowException as error:
        raise UserError(f"{paths[0].parent}: {_clash(paths, schemas) or str(error).splitlines()[0]}") from None


def _clash(paths: Sequence[Path], schemas: Sequence[pa.Schema]) -> str:
    """Which column has types that do not go together, in which files."""
    import pyarrow as pa

    for path, schema in zip(paths, schemas, strict=True):
        for column in schema:
            first = schemas[0].field(column.name) if column.name in schemas[0].names else column
            try:
                pa.unify_schemas([pa.schema([first]), pa.schema([column])], promote_options="permissive")
            except pa.ArrowException:
                where = f"{first.type} in {paths[0].name} and {column.type} in {path.name}"
                return f"{column.name} is {where}; make them alike"
    return ""


FOOTER = ("magic", "footer", "metadata", "thrift", "base64", "schema", "file size")  # of Arrow's words on it


def _damaged(name: str, error: Exception) -> UserError:
    what = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
    if any(word in what.lower() for word in FOOTER):
        what = "what a Parquet file says of itself at its end is missing or broken: was it copied to its end?"
    elif len(what) > 60:
        what = "a part of it cannot be read"
    return UserError(f"{name} is a damaged Parquet file ({what}); write or copy it anew")

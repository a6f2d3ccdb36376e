"""Rows brought into the order of groups and, within a group, of time; equal ones stay as they lay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Floats, Ints, Roles
from credit.logged.tables.columns import codes
from credit.logged.tables.sources import MEMORY, FrameSource, Source

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.tables.clock import Clock


def in_order(source: Source, columns: Sequence[str], roles: Roles, clock: Clock | None, memory: int = MEMORY) -> Source:
    """The same rows, sorted: in memory where they fit, and else by DuckDB.

    Args:
        columns: all that are needed. memory: bytes; without DuckDB four times as many are taken before giving up.

    Raises:
        UserError: there are too many rows to be sorted in memory, and there is no DuckDB.
    """
    rank = _ranks(source, roles.group, "group")
    windows = _ranks(source, roles.window, "window") if clock and not roles.time else {}

    def keys(frame: pd.DataFrame, rows: Ints) -> tuple[Ints, Floats]:
        group = np.zeros(len(rows), dtype=np.int64)
        if roles.group is not None:
            found, names = codes(frame[roles.group])
            group = np.array([rank[name] for name in names.tolist()])[found]
        if windows:  # the time is one within each of them
            found, names = codes(frame[roles.window])
            group = group * len(windows) + np.array([windows[name] for name in names.tolist()])[found]
        time = clock(frame[clock.column], rows, source.name) if clock else np.zeros(len(rows))
        return group, time.astype(np.float64)

    size = source.bytes(len(columns))
    if not isinstance(source, FrameSource) and size > memory:
        from credit.logged.tables.parquets import ParquetSource, by_duckdb

        try:
            assert isinstance(source, ParquetSource)
            return by_duckdb(source, columns, keys, memory)
        except ImportError:
            if size > 4 * memory:
                own = [roles.window, clock.column] if clock and windows else [roles.time]
                named = " and ".join(name for name in (roles.group, *own) if name)
                raise UserError(
                    f"{source.name}: {source.rows} rows are not in the order of {named}, and too many to be sorted in "
                    "memory; pip install 'credit-rl[duckdb]', or sort the files"
                ) from None
    frame, rows = source.whole(columns)
    group, time = keys(frame, rows)
    order = np.lexsort((time, group))
    return FrameSource(frame.iloc[order].reset_index(drop=True), source.name, rows[order])


def _ranks(source: Source, column: str | None, what: str) -> dict[Any, int]:
    """Places of groups, or of windows, in the order of their names."""
    if column is None:
        return {}
    seen: dict[Any, None] = {}
    for frame, rows in source.chunks([column]):
        found, names = codes(frame[column])
        if (found < 0).any():
            row = rows[int((found < 0).argmax())]
            raise UserError(
                f"{source.name}: {column} of row {row} is missing, and it says the row's {what}; fill it in"
            )
        seen |= dict.fromkeys(names.tolist())
    try:
        names_in_order = sorted(seen)
    except TypeError:
        names_in_order = sorted(seen, key=str)
    return {name: i for i, name in enumerate(names_in_order)}


def copies(source: Source) -> str:
    """Rows that are there twice in all columns, in a sentence; "" for none, or where rows do not lie in memory."""
    import pandas as pd

    if not isinstance(source, FrameSource):
        return ""
    frame = source.frame
    plain = frame.astype({name: "str" for name in frame if frame[name].dtype == object})
    keys = pd.util.hash_pandas_object(plain, index=False).to_numpy()
    again = np.flatnonzero(pd.Series(keys).duplicated().to_numpy())
    if not len(again):
        return ""
    first = int(np.flatnonzero(keys == keys[again[0]])[0])
    pair = f"{source.numbers[first]} and {source.numbers[again[0]]}"
    count = f"; {len(again)} rows are copies of others" if len(again) > 1 else ""
    return f"rows {pair} are the same in all columns{count}; keep one of each (in pandas: drop_duplicates)"


def twins(source: Source, columns: Sequence[str], tied: Ints) -> NDArray[np.bool_]:
    """Which rows equal the one before in all columns, of those that share its group, window and time [k].

    Args:
        tied: their places in the order.
    """
    import pandas as pd

    same = np.zeros(len(tied), dtype=bool)
    first, last = 0, None
    for frame, rows in source.chunks(columns):
        inside = (tied >= first) & (tied < first + len(rows))
        at = tied[inside] - first + 1
        whole = pd.concat([frame.iloc[:1] if last is None else last, frame], ignore_index=True)
        equal = np.ones(len(at), dtype=bool)
        for name in columns:
            now, before = whole[name].iloc[at].reset_index(drop=True), whole[name].iloc[at - 1].reset_index(drop=True)
            alike = (now.astype(object) == before.astype(object)) | (now.isna() & before.isna())
            equal &= alike.to_numpy(dtype=bool)
        same[inside] = equal
        first, last = first + len(rows), frame.iloc[-1:]
    return same

"""Rows that are there twice: refused where the table tells its rows apart otherwise, and said where both may be meant.

A log of few states and actions without a time has equal rows that all happened. Where a column of time would tell all
rows apart if the copies were not there, they are copies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.tables.guesses import Sample
from credit.logged.tables.roles import Settled, settled
from credit.logged.tables.sources import SAMPLE, Source, stretches
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    import pandas as pd


def require_single(words: Words, sample: Sample, source: Source, labels: pd.DataFrame | None) -> list[str]:
    """Refuse copies of rows, and say where there may be some.

    Raises:
        UserError: rows that are there twice in all columns, and without which each has its own time.
    """
    again = copies(sample)
    if not again.any():
        return []
    said = _said(sample, source, again)
    column = None if words.time is False else _told_apart(words, sample, again, labels)
    if column is not None:
        raise UserError(
            f"{source.name}: {said}, and without them {column} tells all rows apart; keep one of each (in pandas: "
            "drop_duplicates), or say data.time=false if all of them happened"
        )
    return [f"{said}; they are taken as rows that all happened: keep one of each if they are copies"]


def said_copies(sample: Sample, source: Source) -> list[str]:
    """A sentence on rows that are there twice in all columns."""
    again = copies(sample)
    return [_said(sample, source, again)] if again.any() else []


def copies(sample: Sample) -> NDArray[np.bool_]:
    """Which rows equal an earlier one in all columns [n]."""
    return keys(sample.frame).duplicated().to_numpy()


def keys(frame: pd.DataFrame) -> pd.Series[int]:
    """A number of each row's values; words of any kind are compared as text."""
    import pandas as pd

    plain = frame.astype({name: "str" for name in frame if frame[name].dtype == object})
    return pd.util.hash_pandas_object(plain, index=False)


def _said(sample: Sample, source: Source, again: NDArray[np.bool_]) -> str:
    count, some = int(again.sum()), "" if len(sample) == source.rows else f" of the {len(sample)} that were looked at"
    hashes = keys(sample.frame).to_numpy()
    second = int(again.argmax())
    first = int(np.flatnonzero(hashes == hashes[second])[0])
    numbers = np.arange(len(sample)) if source.rows <= SAMPLE else stretches(source.rows)
    pair = f"rows {numbers[first]} and {numbers[second]} are the same in all columns"
    return pair + (f"; {count} rows{some} are copies of others" if count > 1 else "")


def _told_apart(words: Words, sample: Sample, again: NDArray[np.bool_], labels: pd.DataFrame | None) -> str | None:
    """The column of time that tells all other rows apart; None: there is none, or copies of it are found later."""
    rest = Sample(sample.frame[~again].reset_index(drop=True), sample.source)
    rest.kinds.update(sample.kinds)
    try:
        found: Settled = settled(words, rest, labels)
    except UserError:
        return None  # it is refused as it is, or its copies are no reason
    roles, clock = found.roles, found.clock
    if clock is None or (words.time and roles.time):  # times that were said are looked at in all rows
        return None
    own = rest.codes(roles.group, *([] if roles.time else [roles.window]), clock.column)
    return clock.column if int(own.max()) + 1 == len(rest) else None

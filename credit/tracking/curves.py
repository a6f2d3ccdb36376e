"""Reading the local journal of a run while it grows, and averaging runs into one curve."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from credit.runs.intervals import bounds_of, mean_interval

SECONDS = "time/seconds"


@dataclass(frozen=True)
class Row:
    """One logging point: the step (primitive environment steps) and every finite metric known there."""

    step: int
    values: dict[str, float]

    @property
    def seconds(self) -> float:
        """Wall seconds since the job started."""
        return self.values.get(SECONDS, 0.0)


@dataclass
class Follower:
    """A `metrics.csv` that is followed while it is written."""

    path: Path
    rows: list[Row] = field(default_factory=list)
    _offset: int = 0
    _last: bytes = b""
    _names: list[str] = field(default_factory=list)

    def follow(self) -> None:
        """Read the whole lines that were added since the last call; all of them where the file was written anew."""
        if not self.path.exists():
            return
        with self.path.open("rb") as handle:
            handle.seek(self._offset - len(self._last))
            new = handle.read()
            if not new.startswith(self._last):  # neither its size nor its inode would tell
                self.rows, self._offset, self._last, self._names = [], 0, b"", []
                handle.seek(0)
                new = handle.read()
        new = new[len(self._last) :]
        whole = new[: new.rfind(b"\n") + 1]
        if not whole:
            return
        self._offset += len(whole)
        self._last = whole[whole.rfind(b"\n", 0, -1) + 1 :]
        for cells in csv.reader(whole.decode().splitlines()):
            if not self._names:
                self._names = cells[1:]
                continue
            with suppress(ValueError):  # a line that a full disk or a crash cut short is no row
                self.rows.append(Row(int(cells[0]), _finite(self._names, cells[1:])))

    def beyond(self, step: int) -> list[Row]:
        """The rows after a step."""
        return [row for row in self.rows if row.step > step]


def _finite(names: list[str], cells: list[str]) -> dict[str, float]:
    values = ((name, float(cell)) for name, cell in zip(names, cells, strict=True) if cell)
    return {name: value for name, value in values if math.isfinite(value)}


def mean_rows(journals: list[list[Row]], after: int = -1, rates: Mapping[str, str] | None = None) -> list[Row]:
    """The mean over runs of every metric, with its 95% interval, which stays where means of it can be.

    Args:
        journals: the rows of each run.
        after: only steps beyond this one.
        rates: what the runs' judge declares to be rates; a session of before says nothing of it.

    Returns:
        A row for each step that all runs have reached, with the metrics that all of them know there: `m` is
        the mean; `interval/m_low` and `interval/m_high` (with `_` for `/` in m) exist for two runs or more.
    """
    tables = [{row.step: row for row in rows if row.step > after} for rows in journals]
    if not tables:
        return []
    steps = sorted(set.intersection(*(set(table) for table in tables)))
    return [_mean_row(step, [table[step].values for table in tables], rates or {}) for step in steps]


def _mean_row(step: int, runs: list[dict[str, float]], rates: Mapping[str, str]) -> Row:
    names = [name for name in runs[0] if all(name in values for values in runs)]
    table = np.array([[values[name] for name in names] for values in runs])
    values = dict(zip(names, table.mean(axis=0).tolist(), strict=True))
    if SECONDS in values:
        values[SECONDS] = max(run[SECONDS] for run in runs)
    if len(runs) > 1:
        bounds = [bounds_of(name, rates, names) for name in names]
        ends = np.array(mean_interval(table)[1:])
        for each in {*bounds} - {None}:
            within = [one == each for one in bounds]
            ends[:, within] = mean_interval(table[:, within], each)[1:]
        for name, low, high in zip(names, *ends.tolist(), strict=True):
            if not name.startswith("time/"):
                stem = f"interval/{name.replace('/', '_')}"
                values[f"{stem}_low"], values[f"{stem}_high"] = low, high
    return Row(step, values)

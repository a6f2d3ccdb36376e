"""The journal of a finished run, and what is said of a file that is damaged. Light to import: no torch."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

JOURNAL = "metrics.csv"
STEP = "step"


def read_rows(folder: Path, columns: Collection[str] | None = None) -> pd.DataFrame:
    """The journal of a run: numbers, a row a time, later and later.

    Args:
        folder: of the run. columns: those that are wanted beside `step`, where it has them; all by default.

    Raises:
        OSError: it cannot be read.
        ValueError: it is damaged; with the line.
    """
    text = (folder / JOURNAL).read_text(encoding="utf-8")
    lines = text.splitlines()
    names = lines[0].split(",") if lines else []
    if STEP not in names:
        raise ValueError(f"line 1: no column {STEP!r}")
    if twice := [name for place, name in enumerate(names) if name in names[:place]]:
        raise ValueError(f"line 1: two columns {twice[0]!r}")
    if len(lines) == 1:
        raise ValueError("line 2: there is none, and so no row")
    if not text.endswith("\n"):
        raise ValueError(f"line {len(lines)}: it is cut short, without an end of line")
    for number, line in enumerate(lines, 1):
        if (found := line.count(",") + 1) != len(names):
            raise ValueError(f"line {number}: {found} columns, and line 1 has {len(names)}")
    wanted = [name for name in names if columns is None or name in (STEP, *columns)]
    try:
        frame = pd.read_csv(io.StringIO(text), usecols=wanted, dtype=float)
    except ValueError as error:
        raise ValueError(_no_number(lines, names, wanted) or str(error)) from None
    steps = frame[STEP].to_numpy()
    whole = np.isfinite(steps) & (steps == np.round(steps))
    good = whole & (np.diff(steps, prepend=-np.inf) > 0)
    if not good.all():
        row = int(np.argmin(good))
        before = f" after {steps[row - 1]:g}" if row else ""
        raise ValueError(f"line {row + 2}: step {steps[row]:g}{before}; steps are whole and rise from row to row")
    return frame


def require_columns(found: Collection[str], known: Mapping[str, object]) -> None:
    """Refuse a journal that lacks what its run is known to have measured.

    Args:
        found: its columns. known: the last value of every metric, None or NaN for none.

    Raises:
        ValueError: with the first that it lacks.
    """
    for name, value in known.items():
        if name not in found and isinstance(value, int | float) and value == value:
            raise ValueError(f"line 1: no column {name!r}, of which the run ended with {value:g}")


def unusable(folder: Path, name: str, error: Exception) -> str:
    """What is said of a file of a finished run that is damaged.

    Args:
        folder: of the run. name: of the file. error: why it cannot be used.
    """
    why = "is missing" if isinstance(error, FileNotFoundError) else f"cannot be used ({type(error).__name__}: {error})"
    return (
        f"{folder} is marked as finished, but its {name} {why}. "
        "Restore the file, or move the folder elsewhere and run this seed again."
    )


def _no_number(lines: list[str], names: list[str], wanted: Collection[str]) -> str | None:
    """The first value that is no number, with its line."""
    for number, line in enumerate(lines[1:], 2):
        for name, value in zip(names, line.split(","), strict=True):
            try:
                float(value or "nan")
            except ValueError:
                if name in wanted:
                    return f"line {number}: {name} is {value!r}, and it must be a number"
    return None

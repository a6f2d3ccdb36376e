"""Steps in a CSV or Parquet file, one row a step: as others log them, and as `keep=[steps]` writes them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError, nearest

if TYPE_CHECKING:
    import pandas as pd

VECTORS = ("observation", "action", "next_observation")  # NAME, or NAME_0, NAME_1, … where there are several numbers
REQUIRED = VECTORS
SINGLE = ("episode", "step", "terminated", "reward", "success", "window", "label")
SUFFIXES = (".csv", ".parquet")
MEANING = b"credit.recover"  # of a Parquet file's metadata: what its columns are, as `credit recover` has it, in JSON
NAMES = ", ".join((*(f"{name} (or {name}_0, …)" for name in VECTORS), *SINGLE))
Columns = dict[str, NDArray[Any]]


def read(file: Path) -> Columns:
    """The columns of a file, checked one by one; those of vectors are one array [n, k].

    | column | what it is |
    |---|---|
    | `observation`, `next_observation` | before and behind the step, as learners see it: a number, or `…_0`, `…_1`, … |
    | `action` | in the environment's own numbers: one, or `action_0`, `action_1`, … |
    | `episode` | which one; all rows of one follow each other. Without it all rows are one |
    | `step` | in the episode, counted from 0; without it the first row of an episode is its first step |
    | `terminated` | whether nothing lies behind the step (0 or 1); without it episodes are cut short, and never end |
    | `reward` | r of the step, from which the run's own feedback makes labels |
    | `success` | whether the step is one (0 or 1), for `feedback=success` |
    | `label` | of the window, in its last row; empty elsewhere, and where a window has none. Then r is not needed |
    | `window` | which one; without it a window ends with every label and every episode |

    Raises:
        UserError: no such file, no steps, columns that are missing or unknown, or a value that is none, with its column
            and row.
    """
    frame = _frame(file)
    names = [str(name) for name in frame.columns]
    for name in names:
        if name not in (*VECTORS, *SINGLE) and not re.fullmatch(rf"({'|'.join(VECTORS)})_\d+", name):
            raise UserError(f"{file}: unknown column {name!r}; {nearest(name, (*VECTORS, *SINGLE))}; leave out others")
    if "reward" not in names and "label" not in names:
        raise UserError(f"{file}: there is neither a column label nor reward, and so nothing to learn from ({NAMES})")
    found = {name: _vector(file, frame, name, names) for name in VECTORS}
    if not len(frame):
        raise UserError(f"{file}: there are no steps in it, only the names of columns; give one row a step")
    for name in set(SINGLE) & set(names):
        blank = name in ("label", "reward") and "label" in names  # who has labels may know only some rewards, or none
        found[name] = _numbers(file, frame, name, blank)
    for name in ("terminated", "success"):
        if name in found and not np.isin(found[name], (0, 1)).all():
            row = int((~np.isin(found[name], (0, 1))).argmax())
            raise UserError(f"{file}: {name} of row {row} is {found[name][row]:g}: allowed are 0 and 1")
    return found


def write(file: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as Parquet, whole or not at all.

    Args:
        file: ends in .parquet. columns: name → [n], or [n, k] for vectors.
    """
    import pandas as pd

    flat: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        parts = {name: values} if values.ndim == 1 else {f"{name}_{i}": values[:, i] for i in range(values.shape[1])}
        flat |= parts
    temporary = file.with_name(f".{file.name}")
    pd.DataFrame(flat).to_parquet(temporary, index=False)
    temporary.replace(file)


def numbered(values: NDArray[Any]) -> NDArray[np.int64]:
    """Which stretch of equal values each row is in, counted from 0 [n]."""
    return np.concatenate([[0], np.cumsum(values[1:] != values[:-1])]) if len(values) else np.zeros(0, np.int64)


def _frame(file: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_csv(file) if file.suffix == ".csv" else pd.read_parquet(file)
    except FileNotFoundError:
        raise UserError(f"{file}: there is no such file") from None
    except Exception as error:  # whatever a damaged file makes its reader raise
        what = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise UserError(f"{file} cannot be read ({what}); it must be a table with the columns {NAMES}") from None


def _vector(file: Path, frame: pd.DataFrame, name: str, names: Sequence[str]) -> NDArray[Any]:
    several = [column for column in names if re.fullmatch(rf"{name}_\d+", column)]
    if name in names:
        if several:
            raise UserError(
                f"{file}: there is {name}, and {several[0]} as well; give one number, or all as {name}_0, …"
            )
        return _numbers(file, frame, name)
    wanted = [f"{name}_{i}" for i in range(len(several))]
    if not several or set(several) != set(wanted):
        missing = next((column for column in wanted if column not in several), f"{name}_0")
        raise UserError(f"{file}: there is no column {name}, and no {missing}; the columns are {NAMES}")
    return np.stack([_numbers(file, frame, column) for column in wanted], 1)


def _numbers(file: Path, frame: pd.DataFrame, name: str, blank: bool = False) -> NDArray[Any]:
    """A column of numbers; `blank`: NaN is allowed."""
    column = frame[name]
    if name in ("episode", "window") and column.dtype.kind not in "iufb":
        return numbered(column.to_numpy())  # a name will do
    try:
        values = column.to_numpy(dtype=float)
    except (ValueError, TypeError):
        import pandas as pd

        row = int((pd.to_numeric(column, errors="coerce").isna() & column.notna()).to_numpy().argmax())
        raise UserError(f"{file}: {name} of row {row} is {column.iloc[row]!r}: it must be a number") from None
    good = ~np.isinf(values) if blank else np.isfinite(values)
    if not good.all():
        row = int((~good).argmax())
        raise UserError(f"{file}: {name} of row {row} is {values[row]}: it must be a finite number")
    return values

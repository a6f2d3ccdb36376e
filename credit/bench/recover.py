"""`credit bench recover`: ten million rows from disk to disk, time and memory; the point fit against scikit-learn's."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from credit.bench.measure import Row, taken_in_turns

ROWS, WINDOW, GROUPS, FILES, DRAWS = 10_000_000, 7, 100, 4, 200
ACTIONS, STATES = 4, 12  # with store, day, week and sales twenty columns
NAMES = [f"a{number}" for number in range(ACTIONS)] + [f"z{number}" for number in range(STATES)]
WALL, MEMORY, RATIO, SAME = 300.0, 8.0, 2.0, 1e-10  # seconds, GiB, of scikit-learn's, between shards and one process
ALONE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # the command has what its user has


def run(say: Callable[[str], None]) -> Sequence[Row]:
    """Wall seconds and peak memory of whole commands, here and as jobs a file; the point fit's CPU over its peer's."""
    rows = [*point_fit(ROWS // WINDOW)]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        say(f"writing {ROWS:,} rows as {FILES} files")
        write(folder)
        say("reading, fitting, scoring, writing, in one process")
        wall, peak = recovered(folder, "one")
        what = f"{ROWS:,} rows × {ACTIONS + STATES + 4} columns, windows of {WINDOW}, two models, {DRAWS} draws"
        rows.append(Row(f"{what}, all written: wall", f"{wall:.0f} s", f"at most {WALL:.0f} s", wall <= WALL))
        rows.append(Row("its peak memory", f"{peak:.1f} GiB", f"at most {MEMORY:.0f} GiB", peak <= MEMORY))
        say("the same as jobs, one a file, on two workers")
        wall, _ = recovered(folder, "jobs", "hydra/launcher=local", "hydra.launcher.n_jobs=2")
        apart = difference(folder / "one", folder / "jobs")
        rows.append(Row("the same as jobs, one a file, on two workers: wall", f"{wall:.0f} s"))
        what = "largest difference of their steps, over the largest step"
        rows.append(Row(what, f"{apart:.1e}", f"at most {SAME:.0e}", apart <= SAME))
    return rows


def write(folder: Path) -> None:
    """Stores of as many days each, a quarter of them a file; what a day is worth is linear, with noise of its own."""
    random = np.random.default_rng(0)
    days = ROWS // GROUPS // WINDOW * WINDOW
    worth = random.normal(size=ACTIONS + STATES)
    day = np.arange(days)
    for file in range(FILES):
        writer = None
        for store in range(file * GROUPS // FILES, (file + 1) * GROUPS // FILES):
            values = random.normal(size=(days, len(NAMES)))
            values[:, :ACTIONS] = random.gamma(2.0, size=(days, ACTIONS))
            sales = (values @ worth + random.normal(size=days)).reshape(-1, WINDOW).sum(1).repeat(WINDOW)
            columns = {"store": [f"s{store:03d}"] * days, "day": day, "week": day // WINDOW}
            columns |= {name: values[:, at] for at, name in enumerate(NAMES)}
            table = pa.table(columns | {"sales": sales})
            writer = writer or pq.ParquetWriter(folder / f"{file}.parquet", table.schema)
            writer.write_table(table)
        assert writer is not None
        writer.close()


def recovered(folder: Path, name: str, *words: str) -> tuple[float, float]:
    """Wall seconds and peak memory, GiB, of a command that ends well."""
    command = [
        sys.executable, "-m", "credit", "recover", str(folder / "*.parquet"), f"output={folder}", f"name={name}",
        "tracking=none", f"draws={DRAWS}", f"data.actions=[{','.join(NAMES[:ACTIONS])}]",
        f"data.states=[{','.join(NAMES[ACTIONS:])}]", f"reference.formula=1 + {' + '.join(NAMES)}",
        f"surrogates.actions.formula=1 + {' + '.join(NAMES[:ACTIONS])}", *words,
    ]  # fmt: skip
    environment = {key: value for key, value in os.environ.items() if key not in ALONE}
    begun = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        error = process.stderr.read().decode()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}: {error}")
    return time.perf_counter() - begun, usage.ru_maxrss / 2**20


def difference(one: Path, other: Path) -> float:
    """The largest between two recoveries' steps, over the largest number of each column; folders of recoveries."""
    files = [pq.ParquetFile(folder.parent / "recover" / folder.name / "steps.parquet") for folder in (one, other)]
    apart, largest = dict[str, float](), dict[str, float]()
    for parts in zip(*(file.iter_batches(2**20) for file in files), strict=True):
        for name in parts[0].schema.names:
            if pa.types.is_floating(parts[0].schema.field(name).type):
                here, there = (part.column(name).to_numpy(zero_copy_only=False) for part in parts)
                apart[name] = max(apart.get(name, 0.0), float(np.abs(here - there).max(initial=0)))
                largest[name] = max(largest.get(name, 0.0), float(np.abs(here).max(initial=0)))
    return max(apart[name] / (largest[name] or 1.0) for name in apart)


def point_fit(windows: int, columns: int = 1 + ACTIONS + STATES, rounds: int = 3) -> list[Row]:
    """CPU seconds of the fit to windows [W, D], beside scikit-learn's ridge, and how far apart they are."""
    from sklearn.linear_model import Ridge

    from credit.logged.fits.moments import moments
    from credit.logged.fits.ridge import solutions

    random = np.random.default_rng(0)
    x = random.normal(size=(windows, columns))
    x = (x - x.mean(0)) / x.std(0)  # ours penalises columns of variance 1
    x[:, 0] = WINDOW
    y = x @ random.normal(size=columns) + random.normal(size=windows)
    fold = np.zeros(windows, dtype=np.int64)
    found: dict[str, np.ndarray] = {}

    def ours() -> None:
        theta = solutions(
            moments(x, y, fold, fold, lambda units: np.ones((len(units), 1)), 1, 1)[0], np.array([[1.0]]), 0
        )
        found["ours"] = theta.reshape(-1)

    def peer() -> None:
        fitted = Ridge(1.0).fit(x[:, 1:], y)
        found["peer"] = np.append(fitted.intercept_ / WINDOW, fitted.coef_)

    taken = taken_in_turns({"ours": ours, "peer": peer}, rounds)
    ratio, apart = taken["ours"] / taken["peer"], float(np.abs(found["ours"] - found["peer"]).max())
    what = f"point fit of {windows:,} windows × {columns} columns over scikit-learn's Ridge, CPU"
    return [
        Row(what, f"{taken['ours']:.2f} s, {ratio:.2f}", f"at most {RATIO}", ratio <= RATIO),
        Row("largest difference of their coefficients", f"{apart:.1e}", f"at most {SAME:.0e}", apart <= SAME),
    ]

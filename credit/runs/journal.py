"""The local journal: every run's own folder, written while it runs. It is the truth; MLflow mirrors it."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import yaml

from credit.core.errors import UserError
from credit.core.naming import is_metric, is_name
from credit.core.version import __version__

FLUSH_SECONDS = 1.0
SECONDS = "time/seconds"
PACKAGES = ("torch", "numpy", "numba", "gymnasium", "hydra-core", "mlflow")


class Journal:
    """`metrics.csv` of several runs that are computed side by side.

    Args:
        folders: one folder a run; they are created, an old journal in them is replaced. None is a run that is finished:
            its folder is left alone.
        state: what `state_dict` gave when the runs were interrupted. Rows that were written after it stay, and are not
            written again when they are computed again: who has read them has read the truth.

    Raises:
        UserError: an interrupted journal is not there any more.
    """

    def __init__(self, folders: Sequence[Path | None], state: Mapping[str, Any] | None = None) -> None:
        self.folders = list(folders)
        self.last: list[dict[str, float]] = [{} for _ in folders]
        self._columns: list[str] = []
        self._lines: list[list[str]] = [[] for _ in folders]
        self._ahead: list[list[str]] = [[] for _ in folders]  # rows that an interrupted run was ahead of its state
        self._flushed, self._rows = 0.0, 0
        self._begun = time.monotonic()  # the clock on the wall may go back
        if state is None:
            self._clear()
        else:
            self._go_on(state)

    @property
    def seconds(self) -> float:
        """How long the runs have been computed, interruptions left out."""
        return time.monotonic() - self._begun

    def log(self, step: int, values: Mapping[str, Sequence[float]]) -> None:
        """Add a row to every run: metric → one value a run. A value that is not known is NaN and leaves its cell empty.

        Raises:
            ValueError: the metrics differ from those of the first row, or one has a name that is none.
        """
        if not self._columns:
            if bad := [name for name in values if not is_metric(name)]:
                raise ValueError(f"a metric is called {bad[0]!r}; allowed are {is_metric.__doc__} of {is_name.__doc__}")
            self._columns = [*values, SECONDS]
            for lines, ahead in zip(self._lines, self._ahead, strict=True):
                lines += [] if ahead else [",".join(["step", *self._columns]) + "\n"]
                del ahead[:1]
        if [*values, SECONDS] != self._columns:
            raise ValueError(f"the journal has the columns {self._columns}, not {list(values)}")
        seconds = round(self.seconds, 3)
        self._rows += 1
        for index, lines in enumerate(self._lines):
            row = {name: float(column[index]) for name, column in values.items()} | {SECONDS: seconds}
            line = ",".join([str(step), *("" if v != v else repr(v) for v in row.values())]) + "\n"
            if known := self._known(index, line):
                row[SECONDS] = float(known.rpartition(",")[2])
                self._begun -= max(row[SECONDS] - self.seconds, 0.0)  # the times of what follows are later
            else:
                lines.append(line)
            self.last[index] = row
        if time.monotonic() - self._flushed > FLUSH_SECONDS:
            self.flush()

    def flush(self, durable: bool = False) -> None:
        """Write what is buffered; `durable` means that it is there after a power cut, too."""
        for folder, lines in zip(self.folders, self._lines, strict=True):
            if folder is not None and (lines or durable):
                with (folder / "metrics.csv").open("a", encoding="utf-8") as file:
                    file.write("".join(lines))
                    if durable:
                        file.flush()
                        os.fsync(file.fileno())
            lines.clear()
        self._flushed = time.monotonic()

    def state_dict(self) -> dict[str, Any]:
        """Columns, the number of rows, the last one, and the time taken: what to go on from."""
        return {"columns": self._columns, "rows": self._rows, "last": self.last, "seconds": self.seconds}

    def _clear(self) -> None:
        for folder in filter(None, self.folders):
            folder.mkdir(parents=True, exist_ok=True)
            for name in ("DONE", "checkpoint.pt", "metrics.csv", "summary.json", "recovery.npz", "trajectories.npz"):
                (folder / name).unlink(missing_ok=True)

    def _go_on(self, state: Mapping[str, Any]) -> None:
        self._columns, self._rows, self.last = list(state["columns"]), state["rows"], list(state["last"])
        self._begun -= state["seconds"]
        written = self._rows + bool(self._columns)  # with the header
        for index, folder in enumerate(self.folders):
            if folder is None:
                continue
            (folder / "summary.json").unlink(missing_ok=True)  # of the interruption
            path = folder / "metrics.csv"
            text = path.read_text(encoding="utf-8") if path.exists() else ""
            whole = text[: text.rfind("\n") + 1]  # the last line may have been cut short
            lines = whole.splitlines(keepends=True)
            if len(lines) < written:
                raise UserError(
                    f"{path}: has {len(lines)} lines, and the checkpoint beside it was written after {written}; "
                    "restore the file, or compute the run anew with rerun=true"
                )
            if whole != text:
                write_atomically(path, whole)
            self._ahead[index] = lines[written:]

    def _known(self, index: int, line: str) -> str | None:
        """The row that an interrupted run has written already, if it is this one but for the time."""
        if not self._ahead[index]:
            return None
        known = self._ahead[index].pop(0)
        if known.rpartition(",")[0] == line.rpartition(",")[0]:
            return known
        # on a GPU the same round may come out otherwise: what follows the old row is of another run
        folder, rest = self.folders[index], 1 + len(self._ahead[index])
        assert folder is not None
        path = folder / "metrics.csv"
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        write_atomically(path, "".join(lines[:-rest]))
        self._ahead[index].clear()
        return None


def write_atomically(path: Path, text: str) -> None:
    """Replace a file so that a reader sees the old or the new one, never a part."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def settle(folder: Path) -> None:
    """Make the files of a folder, and their names, last through a power cut."""
    for path in [*(file for file in folder.iterdir() if file.is_file()), folder]:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def read_json(path: Path) -> dict[str, Any]:
    """What a JSON file of ours says.

    Raises:
        UserError: it is damaged. OSError: it cannot be read.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise UserError(f"{path}: damaged; restore it, or move {path.parent} away")
    return found


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically; NaN becomes null."""
    write_atomically(path, json.dumps(_finite(content), indent=2, ensure_ascii=False) + "\n")


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write a YAML file atomically, keys in their own order."""
    write_atomically(path, yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True))


@cache
def git_commit() -> str | None:
    """The commit of the checkout that credit runs from, with `-dirty` where it was changed; None outside one."""
    root = Path(__file__).resolve().parents[2]
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


@cache
def versions() -> dict[str, str]:
    """Versions of the packages that decide a result."""
    found = {"credit": __version__}  # of the code that runs, whatever is installed beside it
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if value == value and abs(value) != float("inf") else None
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return value

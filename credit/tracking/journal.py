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

FLUSH_SECONDS = 1.0
PACKAGES = ("credit", "torch", "numpy", "gymnasium", "hydra-core", "mlflow")


class Journal:
    """`metrics.csv` of several runs that are computed side by side.

    Args:
        folders: one folder a run; they are created, an old journal in them is replaced.
        started: when the job started, epoch seconds.
    """

    def __init__(self, folders: Sequence[Path], started: float) -> None:
        self.folders = list(folders)
        self.last: list[dict[str, float]] = [{} for _ in folders]
        self._started = started
        self._columns: list[str] = []
        self._lines: list[list[str]] = [[] for _ in folders]
        self._flushed = 0.0
        for folder in self.folders:
            folder.mkdir(parents=True, exist_ok=True)
            for name in ("metrics.csv", "summary.json", "recovery.npz", "trajectories.npz", "DONE"):
                (folder / name).unlink(missing_ok=True)

    def log(self, step: int, values: Mapping[str, Sequence[float]]) -> None:
        """Add a row to every run: metric → one value a run. A value that is not known is NaN and leaves its cell empty.

        Raises:
            ValueError: the metrics differ from those of the first row.
        """
        if not self._columns:
            self._columns = [*values, "time/seconds"]
            header = ",".join(["step", *self._columns]) + "\n"
            for lines in self._lines:
                lines.append(header)
        if [*values, "time/seconds"] != self._columns:
            raise ValueError(f"the journal has the columns {self._columns}, not {list(values)}")
        seconds = round(time.time() - self._started, 3)
        for index, lines in enumerate(self._lines):
            row = {name: float(column[index]) for name, column in values.items()} | {"time/seconds": seconds}
            self.last[index] = row
            lines.append(",".join([str(step), *("" if v != v else repr(v) for v in row.values())]) + "\n")
        if time.monotonic() - self._flushed > FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write what is buffered."""
        for folder, lines in zip(self.folders, self._lines, strict=True):
            if lines:
                with (folder / "metrics.csv").open("a", encoding="utf-8") as file:
                    file.write("".join(lines))
                lines.clear()
        self._flushed = time.monotonic()


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
    found = {}
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

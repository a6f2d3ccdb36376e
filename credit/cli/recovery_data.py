"""What `credit recover` is given, where that is a run's folder: its windows as a table, and what their columns are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from credit.core.errors import UserError
from credit.logged.tables.exported import ADAPTIVE, CATEGORIES, adopted
from credit.logged.tables.sources import CSV, PARQUET, FrameSource, files


def is_run(data: Any) -> bool:
    """Whether this is the folder of a run, or of all seeds of one."""
    if not isinstance(data, str | Path) or not Path(data).is_dir():
        return False
    folder = Path(data)
    return (folder / "config.yaml").exists() or any(folder.glob("seed-*/config.yaml"))


def is_csv(data: str) -> bool:
    """Whether the files that are meant are CSV."""
    try:
        return not is_run(data) and files(data)[0].suffix.lower() in CSV
    except UserError:  # of no files: what it is, and whether it is wrong, is said where it is opened
        return data.lower().endswith(".csv")


def pattern_of(data: str) -> str:
    """The name of a file, of a folder, or of a pattern: the last part that has letters beside its wildcards."""
    for part in reversed(Path(data).parts):
        name = re.sub(r"\[[^\]]*\]|[*?]", "", part)
        stem = Path(name).stem.strip(" -_.") if name != part or part == Path(data).name else name
        if stem and not (name != part and f".{stem}" in CSV + PARQUET):  # *.csv
            return stem
    return Path.cwd().name


def resolved(data: Any, words: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """A run's folder as a table, with the words that say what its columns are; anything else as it is.

    Args:
        data: what was given. words: `data.*` without the prefix; they count more than what a run says of itself.

    Raises:
        UserError: the run is not finished, or kept no windows.
    """
    words = {word: value for word, value in words.items() if value is not None}
    if not is_run(data):
        return data, words
    from credit.runs.steps import learned

    found = learned(data)
    frame = found.frame
    for name, size in found.words["sizes"].items():
        if size <= CATEGORIES:
            frame[name] = frame[name].astype("category")
    return FrameSource(frame, str(data), said=(ADAPTIVE,)), adopted(found.words, words)


def name_of(data: str) -> str:
    """What the recovery of a run is called: experiment, method, variant and seed."""
    return "-".join(Path(data).resolve().parts[-4:])

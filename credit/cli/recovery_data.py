"""What `credit recover` is given, where that is a run's folder: its windows as a table, and what their columns are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from credit.logged.tables.exported import ADAPTIVE, CATEGORIES, adopted
from credit.logged.tables.sources import FrameSource


def is_run(data: Any) -> bool:
    """Whether this is the folder of a run, or of all seeds of one."""
    if not isinstance(data, str | Path) or not Path(data).is_dir():
        return False
    folder = Path(data)
    return (folder / "config.yaml").exists() or any(folder.glob("seed-*/config.yaml"))


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

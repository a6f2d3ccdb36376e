"""What `credit recover` is given, where that is a run's folder: its windows as a table, and what their columns are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from credit.logged.tables.sources import FrameSource

CATEGORIES = 50  # states or actions at most that are categories, for linear models; more are one number
ADAPTIVE = (
    "an agent chose the actions by what it had seen before: intervals are not valid under adaptive collection, and "
    "labels of later windows are no independent evidence"
)


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
    frame, own = found.frame, dict(found.words)
    for name, size in own["sizes"].items():
        if size <= CATEGORIES:
            frame[name] = frame[name].astype("category")
    if "states" in words:  # columns of one's own
        own["next_states"] = []
    features = {*words.get("states", own["states"]), *words.get("actions", own["actions"])}
    own["sizes"] = {name: size for name, size in own["sizes"].items() if name in features}
    return FrameSource(frame, str(data), said=(ADAPTIVE,)), own | words


def name_of(data: str) -> str:
    """What the recovery of a run is called: experiment, method, variant and seed."""
    return "-".join(Path(data).resolve().parts[-4:])

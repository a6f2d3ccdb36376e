"""A Minari dataset as a table: a row a step, and a label for every episode, or every few steps of one.

A dataset has a reward for every step, and what is learned from here is what a run with late rewards would have been
told: their sum over a window, or their mean, their last, or whether a step was a success, as `data.label_is` says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.data.minari import Recorded, episodes
from credit.logged.tables.sources import FrameSource
from credit.logged.tables.words import Words

PREFIX = "minari:"
FILE, FACTS = "main_data.hdf5", "metadata.json"
LARGEST = 200_000_000  # numbers, of which a table in memory may have so many
WIDEST = 1_000  # numbers of an observation, or of an action


def dataset(data: Any) -> str | None:
    """The name or folder of a dataset, where one is meant: `minari:NAME`, or a folder with Minari's file in it."""
    if not isinstance(data, str | Path):
        return None
    if str(data).startswith(PREFIX):
        return str(data).removeprefix(PREFIX)
    folder = Path(data)
    if any((folder / place / FILE).is_file() for place in ("", "data")):
        return str(data)
    if any((folder / place / FACTS).is_file() for place in ("", "data")):
        raise UserError(
            f"{data}: this is the folder of a Minari dataset, and its steps are missing ({FILE}); was it downloaded or "
            "copied to its end?"
        )
    return None


def opened(name: str, words: Words) -> tuple[FrameSource, dict[str, Any]]:
    """A dataset as a table, and the words that say what its columns are.

    Args:
        name: of the dataset, or its folder. words: `steps` says how long windows are, `label_is` what labels are.

    Raises:
        UserError: there is none, labels are all alike or of no such kind, or steps are too large or too many for a
            table in memory.
    """
    import pandas as pd

    frames, numbers, window = list[pd.DataFrame](), 0, 0
    least, most = np.inf, -np.inf
    for each in episodes(name):
        columns, count = _columns(each, name), len(each.actions)
        numbers += len(columns) * count
        if numbers > LARGEST:
            raise UserError(
                f"{name}: it has more than {LARGEST:.0e} numbers, and a Minari dataset is held in memory; write it as "
                "Parquet files (one row a step, with columns window and label), which are read in parts"
            )
        least, most = min(least, float(each.rewards.min())), max(most, float(each.rewards.max()))
        place = np.arange(count) // (words.steps or count)
        columns |= {"window": window + place, "label": _labels(each, place, words, name)}
        window += int(place[-1]) + 1
        frames.append(pd.DataFrame({"episode": each.number, "step": np.arange(count), **columns}))
    if not frames:
        raise UserError(f"{name}: it has no episodes")
    if len({tuple(frame.columns) for frame in frames}) > 1:
        raise UserError(f"{name}: its episodes have observations or actions of other sizes; give episodes of one kind")
    frame = pd.concat(frames, ignore_index=True)
    names = [str(column) for column in frame]
    states = [column for column in names if column.startswith("observation")]
    actions = [column for column in names if column.startswith("action")]
    if actions == ["action"] and frame["action"].dtype.kind in "iub":
        frame["action"] = frame["action"].astype("category")
    if (known := frame["label"].dropna()).nunique() == 1:
        raise UserError(
            f"{name}: all {len(known)} labels are {known.iloc[0]:g} (of rewards from {least:g} to {most:g}), and where "
            "labels are alike nothing can be told of steps; take episodes that differ in what they brought"
            + (", or other windows (data.steps=T) or labels (data.label_is)" if least < most else "")
        )
    what = f"{words.steps} steps of an episode" if words.steps else "an episode (data.steps=T: T steps)"
    label_is = words.label_is or "sum"
    said = f"a window is {what}, and its label the {_SAID[label_is]} of its rewards"
    found = {
        "window": "window", "label": "label", "time": False, "group": False, "label_is": label_is,
        "states": states, "actions": actions,
    }  # fmt: skip
    return FrameSource(frame, name, said=(said,)), found


_SAID = {"sum": "sum", "mean": "mean", "last": "last", "binary": "success, whatever the sum"}


def _labels(episode: Recorded, place: NDArray[Any], words: Words, name: str) -> NDArray[np.float64]:
    """The label of each window in its last row, NaN elsewhere [L]."""
    values = episode.rewards
    if words.label_is == "binary":
        if episode.success is None:
            raise UserError(f"{name}: data.label_is=binary: the dataset does not say what is a success; leave it out")
        values = episode.success.astype(float)
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    ends = np.append(starts[1:], len(place)) - 1
    sums = np.add.reduceat(values, starts)
    label = {
        "mean": sums / (ends - starts + 1),
        "last": values[ends],
        "binary": (sums > 0).astype(float),
    }.get(words.label_is or "sum", sums)
    found = np.full(len(place), np.nan)
    found[ends] = label
    return found


def _columns(episode: Recorded, name: str) -> dict[str, NDArray[Any]]:
    """Name → column [L] of what was observed before each step, and what was done."""
    count = len(episode.actions)
    found: dict[str, NDArray[Any]] = {}
    for prefix, value in (*_parts("observation", episode.observations), ("action", episode.actions)):
        values = np.asarray(value)[:count]
        flat = values.reshape(count, -1)
        if flat.shape[1] > WIDEST:
            raise UserError(
                f"{name}: {prefix} has {flat.shape[1]} numbers, at most {WIDEST} are columns of a table; reduce "
                "it first"
            )
        single = values.ndim == 1
        found |= {prefix if single else f"{prefix}_{i}": column for i, column in enumerate(flat.T)}
    return found


def _parts(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The arrays of nested observations, each with the name of its columns."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _parts(f"{name}_{key}", inner)
    elif isinstance(value, tuple):
        for number, inner in enumerate(value):
            yield from _parts(f"{name}_{number}", inner)
    else:
        yield name, value

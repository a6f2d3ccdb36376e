"""Tables that `credit export` wrote, or that have just its columns: read as the windows of a run are."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from credit.core.errors import UserError
from credit.data.tables import MEANING, VECTORS
from credit.logged.tables.guesses import Sample
from credit.logged.tables.sources import PARQUET, Source, files

CATEGORIES = 50  # states or actions at most that are categories, for linear models; more are one number
ADAPTIVE = (
    "an agent chose the actions by what it had seen before: intervals are not valid under adaptive collection, and "
    "labels of later windows are no independent evidence"
)
NEEDED, OTHERS = ("window", "label"), ("seed", "episode", "step", "terminated")  # beside observations and actions
LISTS = ("states", "actions", "next_states")
ALIKE = "its columns are those of `credit export`, and so it is read as the windows of a run"
UNSAID = (
    "; whether a label is a sum, a mean or the last reward, the run's folder or a Parquet file says (data.label_is)"
)


def exported(data: Any, source: Source, sample: Sample, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The words that say what the columns of an export are, but for those given, and what there is to say.

    States and actions that are numbers of a finite space become categories of the sample.

    Args:
        data: what was given. source: the same, located. sample: some of its rows. given: words that count more.

    Returns:
        `given`, and no sentence, where it is no export, or a run's folder that has said it all.
    """
    if isinstance(data, Source) or given.get("labels") is not None:
        return dict(given), []
    own = _written(data)
    said = [ADAPTIVE]
    if own is None:
        if (own := _alike(source, sample)) is None:
            return dict(given), []
        said = [ALIKE + ("" if given.get("label_is") else UNSAID), ADAPTIVE]
    if not {name for word in LISTS for name in own[word]} | {*own["sizes"]} <= {*source.columns}:
        return dict(given), []  # somebody took columns out
    for name, size in own["sizes"].items():
        if size <= CATEGORIES:
            sample.kinds[name] = "category"
    return adopted(own, given), said


def adopted(own: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """What a run's table says of itself, and what a user says, who counts more."""
    own, given = dict(own), {word: value for word, value in given.items() if value is not None}
    if "states" in given:  # columns of one's own
        own["next_states"] = []
    features = {*given.get("states", own["states"]), *given.get("actions", own["actions"])}
    own["sizes"] = {name: size for name, size in own["sizes"].items() if name in features}
    return own | given


def _written(data: Any) -> dict[str, Any] | None:
    """What Parquet files say of themselves, if all say the same."""
    if not isinstance(data, str | Path | list | tuple):
        return None
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        paths = [path for path in files(data) if path.suffix.lower() in PARQUET]
        texts = {(pq.read_schema(path).metadata or {}).get(MEANING) for path in paths}
    except (UserError, pa.ArrowException, OSError):
        return None
    text = texts.pop() if len(texts) == 1 else None
    try:
        found = json.loads(text) if text else None
    except ValueError:
        return None
    if not isinstance(found, dict) or not {"window", "label", *LISTS, "sizes"} <= found.keys():
        return None
    whole = all(isinstance(found[name], list) for name in LISTS) and isinstance(found["sizes"], dict)
    return found if whole else None


def _alike(source: Source, sample: Sample) -> dict[str, Any] | None:
    """The same by the names of all columns, and by whole numbers; None: it has others."""
    parts = {name: [one for one in source.columns if re.fullmatch(rf"{name}(_\d+)?", one)] for name in VECTORS}
    rest = {*source.columns} - {one for several in parts.values() for one in several}
    if not all(parts.values()) or not {*NEEDED} <= rest <= {*NEEDED, *OTHERS}:
        return None
    if any(sample.kinds[name] != "number" for several in parts.values() for name in several):
        return None
    sizes = {}
    for name, columns in (("observation", ("observation", "next_observation")), ("action", ("action",))):
        if parts[name] == [name] and (size := _size(source, sample, columns)):
            sizes[name] = size
    return {
        "window": "window",
        "label": "label",
        "time": False,
        "group": "seed" if "seed" in rest else False,
        "states": parts["observation"],
        "actions": parts["action"],
        "next_states": parts["next_observation"],
        "sizes": sizes,
    }


def _size(source: Source, sample: Sample, columns: tuple[str, ...]) -> int:
    """How many numbers of a finite space there are, as far as is seen; 0: they are no whole numbers from 0 on."""
    if any(name not in source.columns or sample.frame[name].dtype.kind not in "iu" for name in columns):
        return 0
    low, high = 0, 0
    for frame, _ in source.chunks(columns):
        values = frame.to_numpy()
        if values.dtype.kind not in "iu":
            return 0
        low, high = min(low, int(np.min(values))), max(high, int(np.max(values)))
    return high + 1 if low == 0 else 0

"""The labelled windows that a finished run learned from, as a table with a row a step, for `credit recover` and others.

Nothing is kept for it. Where states and actions are numbers, `recovery.npz` has all windows; elsewhere a run keeps its
steps where it is asked to (`keep=[steps]`). The columns are those of `data/tables.py`, so that another run can start
from the file (`demonstrations_from`), too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from credit.config import schema
from credit.core.errors import UserError
from credit.data.tables import MEANING
from credit.envs.feedback import Mean
from credit.envs.recorded import STEPS
from credit.rounds import problem_of
from credit.runs.evaluate import seeds_of
from credit.runs.load import load

if TYPE_CHECKING:
    import pandas as pd

    from credit.core.problem import Problem
    from credit.core.seams import Feedback

SEED = "seed"  # the column that tells runs apart, where there are several
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Learned:
    """The windows of a run.

    Attributes:
        frame: a row a step, in order. words: what its columns are, as `credit recover` has it (`data.*`).
    """

    frame: pd.DataFrame
    words: Mapping[str, Any]


def learned(run: str | Path) -> Learned:
    """The windows that a finished run learned from.

    Args:
        run: the folder of a seed, or of all seeds of a run: then all, with a column `seed`.

    Raises:
        UserError: no finished run lies there, or one that kept no windows.

    Example:
        >>> learned("outputs/advertiser/disagreement/default/seed-0").frame[["window", "observation", "label"]]
    """
    import pandas as pd

    places = seeds_of(Path(run))
    first = _problem(places[0])
    frames = [_steps(place, *first) for place in places]
    if len(places) == 1:
        frame = frames[0]
    else:
        seeds = [int(place.name.rpartition("-")[2]) for place in places]
        pairs = zip(seeds, frames, strict=True)
        frame = pd.concat([each.assign(**{SEED: seed})[[SEED, *each.columns]] for seed, each in pairs])
    return Learned(frame.reset_index(drop=True), _words(frame, *first))


def write(run: str | Path, file: Path) -> Path:
    """Write the windows of a run as CSV or Parquet, as the file's ending says: whole, or not at all.

    Parquet says itself what its columns are (`MEANING` of its metadata).

    Raises:
        UserError: as `learned`; nothing was written.
    """
    found = learned(run)
    frame = found.frame
    partial = file.with_name(f".{file.name}.partial")
    try:
        if file.suffix == ".csv":
            frame.to_csv(partial, index=False)
        else:
            import pyarrow as pa
            import pyarrow.parquet as pq

            table = pa.Table.from_pandas(frame, preserve_index=False)
            meaning = {**(table.schema.metadata or {}), MEANING: json.dumps(found.words)}
            pq.write_table(table.replace_schema_metadata(meaning), partial)
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)
    return file


def _problem(place: Path) -> tuple[Problem, Feedback]:
    config = load(place).config
    env, feedback = schema.build(config, "env"), schema.build(config, "feedback")
    rolling = config["trainer"].get("steps_per_round") is not None
    return problem_of(env, feedback, (int(config["seed"]),), "cpu", rolling), feedback


def _steps(place: Path, problem: Problem, feedback: Feedback) -> pd.DataFrame:
    """A row a step of one seed."""
    import pandas as pd

    arrays = load(place).recovery or {}
    known = len(arrays["windows/labels"]) if "windows/labels" in arrays else None
    if (place / STEPS).exists():
        frame = pd.read_parquet(place / STEPS)
        if known in (None, int(frame["window"].max()) + 1):  # else the run had begun with other windows, and has all
            return frame
    if known is None:
        raise UserError(
            f"{place}: the run kept no windows: states are vectors, whose steps are kept where that is asked for; "
            "compute it again with keep=[steps] rerun=true"
        )
    return pd.DataFrame(_of_arrays(arrays, problem, feedback))


def _of_arrays(arrays: Arrays, problem: Problem, feedback: Feedback) -> dict[str, NDArray[Any]]:
    """Name → column [n] of windows [K, T] with −1 behind the end of shorter ones."""
    states = arrays["windows/states"]
    there = states >= 0
    window, place = np.nonzero(there)
    last = np.append(np.diff(window) != 0, True)
    found = {}
    if not problem.episodic:
        found = {"episode": np.zeros_like(window), "step": np.arange(len(window))}
    elif feedback.lengths is None and problem.window == problem.horizon:  # windows are episodes
        found = {"episode": window, "step": place}
    return found | {
        "observation": states[there],
        "action": arrays["windows/actions"][there],
        "next_observation": arrays["windows/next_states"][there],
        "window": window,
        "label": np.where(last, arrays["windows/labels"][window], np.nan),
    }


def _words(frame: pd.DataFrame, problem: Problem, feedback: Feedback) -> dict[str, Any]:
    """What columns are; where states and actions are numbers, how many there are of them."""
    columns = [str(name) for name in frame.columns]
    named = {name: _named(name, columns) for name in ("observation", "action", "next_observation")}
    sizes = dict[str, int]()
    if problem.finite_states:
        sizes["observation"] = problem.states
    if problem.finite_actions:
        sizes["action"] = problem.actions
    kinds = {"last": "last", "success": "binary"}
    return {
        "window": "window",
        "label": "label",
        "label_is": "mean" if isinstance(feedback, Mean) else kinds.get(str(feedback.objective), "sum"),
        "time": False,  # rows lie as they were taken; what is carried from one to the next is in the states
        "group": SEED if SEED in columns else False,
        "states": named["observation"],
        "actions": named["action"],
        "next_states": named["next_observation"],
        "sizes": sizes,
    }


def _named(name: str, columns: Sequence[str]) -> list[str]:
    """The columns of a number, or of a vector."""
    return [one for one in columns if one == name or one.removeprefix(f"{name}_").isdecimal()]

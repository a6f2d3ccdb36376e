"""What a learner believes about the reward at the end, and how far, as maps: cell by cell, or over two axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.report.groups import display_name, ordered_groups
from credit.report.labels import circumstances
from credit.report.reading import arrays
from credit.report.runs import Runs
from credit.report.statistics import Array

FILE = "recovery.npz"
MOST_CELLS = 60
PAIRS = ("state", "action")
Axes = Mapping[str, NDArray[np.int64]]  # name → place of every cell of a table on this axis, horizontal first


@dataclass(frozen=True, eq=False)
class Block:
    """Maps that belong together, each [vertical, horizontal]; NaN where no cell of a table falls.

    Attributes:
        title: which steps; empty where the tables do not depend on the step.
        tables: title → maps on one scale: rewards, or what tells how far these can be trusted.
        last_title, last: the map of another scale that stands last: the reference's weight, or visits.
        seen: whether any cell of a group was visited; what was not is a plain mean over its cells.
    """

    title: str
    tables: Mapping[str, Array]
    last_title: str
    last: Array
    seen: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Maps:
    """All maps of one method in one setting.

    Attributes:
        title: whose, and from which seeds.
        axes: what the maps are drawn over, the horizontal axis first.
        by_cell: whether each field of a map is one cell of the tables.
        blocks: one, or two where the tables depend on the step.
        units: what the tables and the last map are in.
    """

    title: str
    axes: tuple[str, ...]
    by_cell: bool
    blocks: tuple[Block, ...]
    units: tuple[str, str]


def recovered_maps(runs: Runs, seed: int | None = None, doubts: bool = False) -> Maps | None:
    """Truth, every reward model, the mixture and the reference's weight; or how far they can be trusted, and visits.

    Shown is `disagreement`, or the first method that recovers a reward where it has no runs. Tables of at most 60
    cells are averaged over seeds, cell by cell. Larger ones are averaged over the cells of all seeds that fall on one
    field of the two axes of `recovery.npz`, weighted by visits; credit by step is split into the last step and those
    before it.

    Args:
        runs: finished runs of one setting.
        seed: take this seed alone; by default all seeds.
        doubts: instead of rewards √m of every model (10), (11), √Δ̂² of every surrogate (9), in units of the reward, and
            how often a place was visited.

    Returns:
        The maps, or None where the runs have no recovery, or tables that are large and have no axes.

    Raises:
        UserError: the seed is not among the runs, or a file of them is damaged.
    """
    groups = sorted(ordered_groups(runs.frame), key=lambda entry: entry[0] != "disagreement")
    found = next((entry for entry in groups if _recovery_file(entry[2]["folder"].iloc[0]).exists()), None)
    if found is None:
        return None
    _, slug, group = found
    name = display_name(group)
    if seed is not None and seed not in set(group["seed"]):
        raise UserError(
            f"diagnostics_seed={seed} is not among the finished seeds of {name}: "
            f"{group['seed'].min()} to {group['seed'].max()}."
        )
    chosen = group if seed is None else group[group["seed"] == seed]
    who = f"seed {chosen['seed'].iloc[0]}" if len(chosen) == 1 else f"mean over {len(chosen)} seeds"
    return _maps(f"{runs.experiment}: {name}{circumstances(runs, slug)}, end of training, {who}", chosen, doubts)


def _recovery_file(folder: str) -> Path:
    return Path(folder) / FILE


def _maps(title: str, chosen: pd.DataFrame, doubts: bool) -> Maps | None:
    stacks: dict[str, list[Array]] = {}
    for folder in chosen["folder"]:
        with arrays(folder, FILE) as data:
            cells = tuple(data["cells"].tolist()) if "cells" in data else PAIRS
            models = [str(model) for model in data["models"]]
            keys = ["reward/true", *(f"reward/{model}" for model in models), "reward/mixed", f"weight/{models[0]}"]
            shape = data["reward/mixed"].shape
            if doubts:
                squares = [*(f"mse/{model}" for model in models), *(f"disagreement/{model}" for model in models[1:])]
                keys = [key for key in squares if key in data]
            tables = {key: np.asarray(data[key], dtype=float) for key in keys if key in data}
            if doubts:
                tables = {key: np.sqrt(np.maximum(table, 0.0)) for key, table in tables.items()}
            if len(tables) < len(keys) or any(t.shape != shape for t in tables.values()) or len(cells) != len(shape):
                return None
            by_cell = int(np.prod(shape)) <= MOST_CELLS
            axes = _indices(cells, shape) if by_cell else {key[5:]: data[key] for key in data if key[:5] == "axis/"}
            if not axes or not tables:
                return None
            tables["visits"] = np.ones(shape) if by_cell else data["visits"]
            if doubts:
                tables["times"] = np.asarray(data["visits"], dtype=float)
            for key, table in tables.items():
                stacks.setdefault(key, []).append(table)
    tables = {key: np.stack(values) for key, values in stacks.items()}
    block = _doubted if doubts else _rewarded
    blocks = tuple(block(_Fields(tables, axes, where), label, models) for label, where in _steps(cells, shape))
    if not by_cell:
        title += ", weighted by visits"
        unseen = any((~found.seen & np.isfinite(next(iter(found.tables.values())))).any() for found in blocks)
        title += "; hatched: never visited" if unseen else ""
    return Maps(title, tuple(axes), by_cell, blocks, ("reward", "visits" if doubts else "weight"))


def _indices(cells: tuple[str, ...], shape: tuple[int, ...]) -> Axes:
    """Axes of a small table: its own dimensions, but the step."""
    places = zip(cells, np.indices(shape), strict=True)
    return {name.replace("_", " "): place for name, place in places if name != "step"}


def _steps(cells: tuple[str, ...], shape: tuple[int, ...]) -> list[tuple[str, NDArray[np.bool_]]]:
    """Which cells are drawn together: the last step apart, since a label may be all its own."""
    if "step" not in cells:
        return [("", np.ones(shape, dtype=bool))]
    step, last = np.indices(shape)[cells.index("step")], shape[cells.index("step")]
    earlier = [("step 1" if last == 2 else f"steps 1–{last - 1}", step < last - 1)] if last > 1 else []
    return [*earlier, (f"step {last}", step == last - 1)]


class _Fields:
    """Tables of all seeds as maps over the axes: the cells that fall on a field together, weighted by visits."""

    def __init__(self, tables: Mapping[str, Array], axes: Axes, where: NDArray[np.bool_]) -> None:
        columns, *rows = [np.asarray(place, dtype=np.int64) for place in axes.values()]
        lines = rows[0] if rows else np.zeros_like(columns)
        self._size = (int(lines.max()) + 1, int(columns.max()) + 1)
        self.inside = {key: table[:, where] for key, table in tables.items()}
        place = (lines * self._size[1] + columns)[where]
        self._fields = np.broadcast_to(place, self.inside["visits"].shape).ravel()
        self.visits = self.total(self.inside["visits"])

    def total(self, values: Array) -> Array:
        """The sum over the cells of a field, and over seeds."""
        sums = np.bincount(self._fields, values.ravel(), minlength=self._size[0] * self._size[1])
        return np.asarray(sums, dtype=float).reshape(self._size)

    def mean(self, key: str) -> Array:
        """The mean over the cells of a field, and over seeds."""
        inside, visits = self.inside[key], self.inside["visits"]
        with np.errstate(invalid="ignore"):  # 0/0 where no cell falls, or none was visited
            plain = self.total(inside) / self.total(np.ones_like(inside))
            return np.where(self.visits > 0, self.total(inside * visits) / self.visits, plain)


def _rewarded(fields: _Fields, title: str, models: list[str]) -> Block:
    tables, true = {"True reward": fields.mean("reward/true")}, fields.inside["reward/true"]
    for key in [*(f"reward/{model}" for model in models), "reward/mixed"]:
        error = float(np.mean((fields.inside[key] - true) ** 2))
        tables[f"{_words(key).capitalize()} reward (MSE {error:.2g})"] = fields.mean(key)
    reference = f"weight/{models[0]}"
    return Block(title, tables, f"Weight of {_words(reference)}", fields.mean(reference), fields.visits > 0)


def _doubted(fields: _Fields, title: str, models: list[str]) -> Block:
    titles = {"mse": "√MSE proxy of {}", "disagreement": f"|{_words(f'mse/{models[0]}')} − {{}}|"}
    keys = [key for key in fields.inside if key not in ("visits", "times")]
    tables = {titles[key.partition("/")[0]].format(_words(key)): fields.mean(key) for key in keys}
    seeds = len(fields.inside["times"])
    return Block(title, tables, "Visits", fields.total(fields.inside["times"]) / seeds, fields.visits > 0)


def _words(key: str) -> str:
    """The name in a key, as it is written in a title."""
    return key.partition("/")[2].replace("_", " ")

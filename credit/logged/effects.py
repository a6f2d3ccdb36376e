"""What actions were worth: the mean of r̄(s, a) − r̄(s, a₀) over rows, against a stated baseline, with its interval.

What an action carries over to later rows (lag, adstock) is part of its effect: the baseline is that the column always
had the value a₀. A contrast that the windows do not tell gets no number. States get no effects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.fits.mixture import mixed
from credit.logged.models import Pass, parts_of
from credit.logged.panel import Column, Floats, Part
from credit.logged.recovering import Recovered

if TYPE_CHECKING:
    import pandas as pd

ROWS = 20_000  # about as many, evenly spread, tell by how much the effect of a mixture is not the reference's
MIXTURE = "mixture"


@dataclass
class _Sum:
    """What has been added up of one action, or of one of its categories."""

    rows: int = 0  # of which
    sampled: int = 0
    units: float = 0.0  # Σ (a − a₀)
    cost: float = 0.0
    contrast: list[Floats] | None = None  # Σ φ(a) − φ(a₀) of each model
    mixture: Floats | None = None  # Σ over the sampled rows of what it has beyond the reference, in every fit [1 + B]


def effects(found: Recovered) -> pd.DataFrame:
    """A row for each action (and each category of one) and model, the mixture last.

    Columns: action, level (of a category), baseline, model, rows, effect (a row's mean), total, per_unit, per_cost,
    each with _low and _high; told (whether the windows tell it), and note.
    """
    import pandas as pd

    lines: list[dict[str, Any]] = []
    for action in found.panel.roles.actions:
        column = found.panel.columns[action]
        baseline = baseline_of(found, column)
        for level, total in _sums(found, column, baseline).items():
            lines += _lines(found, action, level, baseline, total)
    return pd.DataFrame(lines)


def baseline_of(found: Recovered, column: Column) -> Any:
    """a₀: as given, or 0, or the most frequent category."""
    given = found.panel.roles.baseline.get(column.name)
    if given is not None:
        return given
    return 0.0 if column.levels is None else column.frequent


def _sums(found: Recovered, column: Column, baseline: Any) -> dict[Any, _Sum]:
    """Level (None for a number) → what rows with it come to."""
    levels = [None] if column.levels is None else [level for level in column.levels if level != baseline]
    sums = {level: _Sum() for level in levels}
    columns = found.columns
    thetas = [fit.theta[:, own] for fit, own in zip(found.fits, columns, strict=True)]
    as_is = Pass(found.panel, found.models, columns)
    without = Pass(found.panel, found.models, columns, replaced=(column.name, baseline))
    every = max(1, -(-found.panel.rows // ROWS))
    cost = found.panel.roles.cost.get(column.name)
    for part, at in parts_of(found.panel):
        here, there = as_is.of(part), without.of(part)
        sample = np.arange(len(part))[(np.arange(at.start, at.stop) % every) == 0]
        for level, rows in _rows(part, column, levels):
            total = sums[level]
            total.rows += len(rows)
            if column.levels is None:
                total.units += float((part.frame[column.name].to_numpy(np.float64)[rows] - float(baseline)).sum())
            else:
                total.units += len(rows)
            if cost is not None:
                total.cost += float(part.frame[cost].to_numpy(np.float64)[rows].sum())
            change = [(one[rows] - other[rows]).sum(0) for one, other in zip(here, there, strict=True)]
            total.contrast = (
                change if total.contrast is None else [a + b for a, b in zip(total.contrast, change, strict=True)]
            )
            if len(found.models) > 1:
                some = np.intersect1d(sample, rows)
                total.sampled += len(some)
                ours, base = (
                    mixed([phi[some] for phi in designs], thetas, found.mixer, keep=True) for designs in (here, there)
                )
                assert ours.draws is not None
                assert base.draws is not None
                added = np.concatenate([[(ours.credit - base.credit).sum()], (ours.draws - base.draws).sum(1)])
                added -= thetas[0] @ (here[0][some] - there[0][some]).sum(0)
                total.mixture = added if total.mixture is None else total.mixture + added
    return sums


def _rows(part: Part, column: Column, levels: list[Any]) -> Iterator[tuple[Any, np.ndarray]]:
    if column.levels is None:
        yield None, np.arange(len(part))
        return
    codes = part.frame[column.name].cat.codes.to_numpy()
    place = {level: code for code, level in enumerate(part.frame[column.name].cat.categories)}
    for level in levels:
        yield level, np.flatnonzero(codes == place.get(level, -2))


def _lines(found: Recovered, action: str, level: Any, baseline: Any, total: _Sum) -> Iterator[dict[str, Any]]:
    columns = found.columns
    told, note = True, ""
    assert total.contrast is not None  # a table has a part
    if total.rows:
        whole = np.zeros(len(found.models[0].terms.names))
        whole[columns[0]] = total.contrast[0]
        told = bool(found.telling.answers(whole[found.told_columns]))
    if not total.rows:
        told, note = False, f"{action} is {level!r} in no row"
    elif not told:
        note = "the windows do not tell it from other columns"
    elif not total.units:
        note = f"{action} is {baseline!r} in every row"
    for number, name in enumerate([*found.names, *([MIXTURE] if len(found.models) > 1 else [])]):
        line: dict[str, Any] = {
            "action": action, "level": level, "baseline": baseline, "model": name, "rows": total.rows
        }  # fmt: skip
        if name == MIXTURE and number == len(found.models):
            draws = found.fits[0].theta[:, columns[0]] @ total.contrast[0]
            if total.mixture is not None:
                draws = draws + total.mixture * (total.rows / max(total.sampled, 1))
        else:
            draws = found.fits[number].theta[:, columns[number]] @ total.contrast[number]
        if not told:
            draws = np.full_like(draws, np.nan)
        half = found.factor * (draws[1:].std() if len(draws) > 1 else np.nan)
        for key, by in (
            ("effect", total.rows), ("total", 1), ("per_unit", total.units), ("per_cost", total.cost)
        ):  # fmt: skip
            if key == "per_cost" and action not in found.panel.roles.cost:
                continue
            by = by or np.nan
            low, high = sorted((draws[0] / by - half / by, draws[0] / by + half / by))
            line |= {key: draws[0] / by, f"{key}_low": low, f"{key}_high": high}
        yield line | {"told": told, "note": note}

"""What actions were worth: the mean of r̄(s, a) − r̄(s, a₀) over rows, against a stated baseline, with its interval.

What an action carries over to later rows (lag, adstock) is part of its effect: the baseline is that the column always
had the value a₀. A contrast that the windows do not tell gets no number. States get no effects. One pass over the rows
adds up all that is said of all actions, in total and over time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.fits.mixture import mixed, predicted, summed
from credit.logged.models import Model, Pass, parts_of
from credit.logged.panel import Column, Floats, Ints, Part
from credit.logged.periods import periods
from credit.logged.recovered import Recovered

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.fits.mixture import Theta

ROWS = 20_000  # about as many, evenly spread, tell by how much the effect of a mixture is not the reference's


@dataclass
class _Sum:
    """What has been added up of one action, or of one of its categories."""

    plain: Floats  # Σ φ(a) − φ(a₀) of the linear model by which windows are judged
    contrast: list[Floats]  # Σ r̂(s, a) − r̂(s, a₀) of each model, in every fit [1 + B]
    mixture: Floats  # Σ over the sampled rows of what it has beyond the reference, in every fit [1 + B]
    times: Floats  # by period: rows, Σ of the reference's point fit, sampled rows, Σ over these of `mixture`'s [4, P]
    rows: int = 0  # of which
    sampled: int = 0
    units: float = 0.0  # Σ (a − a₀)
    cost: float = 0.0


@dataclass
class Sums:
    """Of one action: what has been added up of each level that is no baseline, None for a number."""

    column: Column
    baseline: Any
    touched: list[slice | Ints]  # of each model's columns, those in which the action stands
    without: Pass  # these, in rows where the action always was the baseline
    plain: Pass | None  # all columns of the plain model in these rows, where that is not the reference
    levels: dict[Any, _Sum] = field(default_factory=dict)
    kept: float = 0.0  # what rows at the baseline cost, where that is a category

    @property
    def free(self) -> bool:
        """Whether the baseline costs nothing, as far as it is known: what another number would have cost is not."""
        return self.kept == 0 if self.column.levels is not None else float(self.baseline) == 0


def effects(found: Recovered, every: list[Sums]) -> pd.DataFrame:
    """A row for each action (and each category of one) and model, the mixture last, of what `added_up` found.

    Columns: action, level (of a category), baseline, model, rows, effect (a row's mean), total, per_unit, per_cost
    (where costs are known, and the baseline has none), each with _low and _high; told (whether the windows tell it),
    and note.
    """
    import pandas as pd

    lines = [
        line for sums in every for level, total in sums.levels.items() for line in _lines(found, sums, level, total)
    ]
    plain = ["action", "level", "baseline", "model", "rows", *_columns("effect", "total", "per_unit"), "told", "note"]
    frame = pd.DataFrame(lines) if lines else pd.DataFrame(columns=plain)
    return frame.assign(level=pd.Series([line["level"] for line in lines], dtype=object))  # None stays None


def over_time(found: Recovered, every: list[Sums]) -> pd.DataFrame:
    """What each action (and each category of one) brought in each period, by the last model: action, level, period,
    effect (Σ over the period's rows). What the windows do not tell is left out."""
    import pandas as pd

    lines = [pd.DataFrame(columns=["action", "level", "period", "effect"])]
    for sums in every:
        for level, total in sums.levels.items():
            if not _told(found, total):
                continue
            rows, reference, sampled, beyond = total.times
            effect = reference + beyond * rows / np.maximum(sampled, 1)
            one = {"action": sums.column.name, "level": level, "period": np.arange(len(rows)), "effect": effect}
            lines.append(pd.DataFrame(one).astype({"level": object}))
    return pd.concat(lines[1:], ignore_index=True) if lines[1:] else lines[0]


def _columns(*names: str) -> list[str]:
    return [f"{name}{end}" for name in names for end in ("", "_low", "_high")]


def baseline_of(found: Recovered, column: Column) -> Any:
    """a₀: as given, or 0, or the most frequent category."""
    given = found.panel.roles.baseline.get(column.name)
    if given is not None:
        return given
    return 0.0 if column.levels is None else column.frequent


def _started(found: Recovered, column: Column, count: int) -> Sums:
    """Nothing yet, of each of an action's levels, in so many periods."""
    baseline = baseline_of(found, column)
    levels = [None] if column.levels is None else [level for level in column.levels if level != baseline]
    replaced, fits = (column.name, baseline), 1 + found.options.draws
    touched, columns = list[slice | Ints](), list[Ints]()
    for model, own in zip(found.models, found.columns, strict=True):
        at = np.flatnonzero(np.isin(own, model.terms.touching(column.name))) if isinstance(model, Model) else None
        touched.append(slice(None) if at is None else at)
        columns.append(own if at is None else own[at])
    without = Pass(found.panel, found.models, columns, replaced)

    def nothing() -> _Sum:
        plain = np.zeros(len(found.plain_fit.used(found.plain.terms)))
        return _Sum(plain, [np.zeros(fits) for _ in found.models], np.zeros(fits), np.zeros((4, count)))

    return Sums(column, baseline, touched, without, _plain(found, replaced), {level: nothing() for level in levels})


def _plain(found: Recovered, replaced: tuple[str, Any] | None = None) -> Pass | None:
    """The rows as the plain model sees them, where that is not the reference."""
    if found.models[0] is found.plain:
        return None
    return Pass(found.panel, [found.plain], [found.plain_fit.used(found.plain.terms)], replaced)


def added_up(found: Recovered) -> list[Sums]:
    """All actions, in one pass over the rows."""
    thetas, period = found.thetas, periods(found.panel.windows)
    count = int(period.max(initial=-1)) + 1
    actions = [_started(found, found.panel.columns[name], count) for name in found.panel.roles.actions]
    as_is = Pass(found.panel, found.models, found.columns)
    plain = _plain(found)
    every = max(1, -(-found.panel.rows // ROWS))
    several = len(found.models) > 1

    def in_all_fits(designs: list[Floats]) -> Floats:
        """What the mixture has beyond the reference [1 + B, n]."""
        what = mixed(designs, thetas, found.mixer, keep=True)
        assert what.draws is not None
        return np.concatenate([what.credit[None], what.draws]) - predicted(designs[0], thetas[0]).T

    for part, at in parts_of(found.panel, "effects added up") if actions else ():
        here = as_is.of(part)
        when = period[part.window]
        plain_here = None if plain is None else plain.of(part)[0]
        sample = np.flatnonzero(np.arange(at.start, at.stop) % every == 0)
        ours = in_all_fits([phi[sample] for phi in here]) if several else None
        for sums in actions:
            there = sums.without.of(part)
            beyond = None
            if ours is not None:
                theirs = [phi[sample] for phi in here]
                for phi, at_columns, other in zip(theirs, sums.touched, there, strict=True):
                    phi[:, at_columns] = other[sample]
                beyond = ours - in_all_fits(theirs)
            cost = found.panel.roles.cost.get(sums.column.name)
            if cost is not None and sums.column.levels is not None:
                at_base = (part.frame[sums.column.name] == sums.baseline).to_numpy()
                sums.kept += float(part.frame[cost].to_numpy(np.float64)[at_base].sum())
            plain_there = None if sums.plain is None else sums.plain.of(part)[0]
            for level, rows in _rows(part, sums):
                total = sums.levels[level]
                total.rows += len(rows)
                total.units += _units(part, sums, rows)
                total.cost += 0.0 if cost is None else float(part.frame[cost].to_numpy(np.float64)[rows].sum())
                changes = [
                    (one[:, own][rows], other[rows], theta[:, own] if isinstance(theta, np.ndarray) else theta)
                    for one, other, theta, own in zip(here, there, thetas, sums.touched, strict=True)
                ]
                for whole, (one, other, theta) in zip(total.contrast, changes, strict=True):
                    whole += summed(theta, one, other)
                one, other, theta = changes[0]
                change = _point(theta, one) - _point(theta, other)
                if plain_here is None or plain_there is None:
                    total.plain[sums.touched[0]] += (one - other).sum(0)
                else:
                    total.plain += (plain_here[rows] - plain_there[rows]).sum(0)
                total.times[0] += _by(when[rows], np.ones(len(rows)), count)
                total.times[1] += _by(when[rows], change, count)
                if beyond is not None:
                    own = np.isin(sample, rows)
                    total.sampled += int(own.sum())
                    total.mixture += beyond[:, own].sum(1)
                    total.times[2] += _by(when[sample[own]], np.ones(int(own.sum())), count)
                    total.times[3] += _by(when[sample[own]], beyond[0, own], count)
    return actions


def _by(period: Ints, values: Floats, count: int) -> Floats:
    """Σ of values [n] in each period [P]."""
    return np.bincount(period, weights=values, minlength=count).astype(np.float64)


def _point(theta: Theta, design: Floats) -> Floats:
    """What the point fit says of rows [n]."""
    return design @ theta[0] if isinstance(theta, np.ndarray) else predicted(design, theta)[:, 0]


def _told(found: Recovered, total: _Sum) -> bool:
    """Whether the windows tell a contrast that is there."""
    if not total.rows:
        return False
    whole = np.zeros(len(found.plain.terms.names))
    whole[found.plain_fit.used(found.plain.terms)] = total.plain
    return bool(found.telling.answers(whole[found.told_columns]))


def _units(part: Part, sums: Sums, rows: Ints) -> float:
    """Σ (a − a₀) of a number; of a category how often it was there."""
    if sums.column.levels is not None:
        return float(len(rows))
    return float((part.frame[sums.column.name].to_numpy(np.float64)[rows] - float(sums.baseline)).sum())


def _rows(part: Part, sums: Sums) -> Iterator[tuple[Any, Ints]]:
    if sums.column.levels is None:
        yield None, np.arange(len(part))
        return
    series = part.frame[sums.column.name].cat
    codes, place = series.codes.to_numpy(), {level: code for code, level in enumerate(series.categories)}
    for level in sums.levels:
        yield level, np.flatnonzero(codes == place.get(level, -2))


def _lines(found: Recovered, sums: Sums, level: Any, total: _Sum) -> Iterator[dict[str, Any]]:
    """A row a model, of one action or one of its categories."""
    action = sums.column.name
    told, note = _told(found, total), ""
    if not total.rows:
        note = f"{action} is {level!r} in no row"
    elif not told:
        note = "the windows do not tell it from other columns"
    elif not total.units:
        note = f"{action} is {sums.baseline!r} in every row"
    totals = list(total.contrast)
    if len(found.models) > 1:
        totals.append(totals[0] + total.mixture * (total.rows / max(total.sampled, 1)))
    scales = {"effect": total.rows, "total": 1, "per_unit": total.units}
    if action in found.panel.roles.cost:
        scales["per_cost"] = total.cost if sums.free else np.nan
    for name, draws in zip(found.every_name, totals, strict=True):
        value = draws[0] if told else np.nan
        half = found.factor * draws[1:].std()
        line = {"action": action, "level": level, "baseline": sums.baseline, "model": name, "rows": total.rows}
        for key, scale in scales.items():
            by = scale or np.nan
            low, high = sorted(((value - half) / by, (value + half) / by))
            line |= {key: value / by, f"{key}_low": low, f"{key}_high": high}
        yield line | {"told": told, "note": note}

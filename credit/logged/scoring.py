"""What a recovery says of rows: credit, its interval, each model's part, and credit that adds up to the labels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from credit.logged.fits.folds import r_squared
from credit.logged.fits.mixture import mixed
from credit.logged.fitted import Fitted
from credit.logged.models import Pass, aggregated, parts_of
from credit.logged.panel import NOTHING, Floats, Panel, Part
from credit.logged.recovered import Recovered, thetas
from credit.logged.residuals.balance import balanced
from credit.logged.residuals.whitening import Layout, errors
from credit.logged.spreading import mapped

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Scored:
    """All rows, in the order of the panel.

    Attributes:
        credit, low, high, balanced, disagreement: [n]; intervals NaN where there are none, balanced NaN for bits.
        each, weights: of each model [M, n]. number: the row's number in what was given [n].
    """

    credit: Floats
    low: Floats
    high: Floats
    balanced: Floats
    disagreement: Floats
    each: Floats
    weights: Floats
    number: np.ndarray


@dataclass(frozen=True)
class Judged:
    """What windows say of a recovery.

    Attributes:
        fitted: what credit adds up to [W]. held_out: what is predicted of each label by fits that have not seen its
            fold; of each model and the mixture, the last, [M + 1, W]. alike: predicted where all rows are alike [W].
            persistent: that a row is worth what it was in the last labelled window before it [W].
        r_squared: held out, of each model and the mixture, against `alike`; against `persistent` for the second row
            [2, M + 1]. For bits the Brier score takes the place of squared errors, which is the same sum.
    """

    fitted: Floats
    held_out: Floats
    alike: Floats
    persistent: Floats
    r_squared: Floats


def scored(found: Recovered) -> tuple[Scored, Judged]:
    """Score all rows that models were fitted to, and judge them by their windows."""
    slim = replace(found, panel=_Nothing(), plain_design=found.plain_design[:0])
    parts = mapped(partial(_scored, found=slim), found.panel)
    rows = [one for one, _, _ in parts]
    whole = rows[0]
    if len(rows) > 1:
        columns = {one.name: [getattr(some, one.name) for some in rows] for one in fields(Scored)}
        whole = Scored(**{name: np.concatenate(each, axis=-1) for name, each in columns.items()})
    fitted, held_out = (np.concatenate(each, axis=-1) for each in list(zip(*parts, strict=True))[1:])
    return whole, _judged(found, fitted, held_out)


class _Nothing(Panel):
    """In the place of a panel where jobs have their own sections of it."""

    def parts(self) -> Iterator[Part]:
        """None."""
        return iter(())


def _scored(section: Panel, found: Recovered) -> tuple[Scored, Floats, Floats]:
    """Rows of a section, what labels of its windows are by them [w], and by fits that had not seen them [M + 1, w]."""
    own = slice(section.first, section.first + len(section.windows))
    found = replace(found, panel=section, folds=replace(found.folds, piece=found.folds.piece[own]))
    held_out = np.full((len(found.models) + 1, len(section.windows)), np.nan)
    columns = found.columns

    def hold_out(part: Part, own: slice, designs: list[Floats]) -> None:
        _hold_out(found, part, designs, columns, held_out[:, own])

    rows, fitted = credited(found.fitted, section, hold_out)
    return rows, fitted, held_out


def credited(
    fitted: Fitted, panel: Panel, seen: Callable[[Part, slice, list[Floats]], None] | None = None
) -> tuple[Scored, Floats]:
    """Score all rows of a panel in one pass, and what a label of each window is by them [W].

    Args:
        fitted: models. panel: rows, which they need not have seen. seen: called with each part, the places of its
            windows and the models' designs.
    """
    count, models = panel.rows, len(fitted.parts)
    credit, half, disagreement = np.empty(count), np.empty(count), np.empty(count)
    each, weights, number = np.empty((models, count)), np.empty((models, count)), np.empty(count, dtype=np.int64)
    sums = np.empty(len(panel.windows))
    thetas = [one.theta for one in fitted.parts]
    rows = Pass(panel, fitted.models, [one.columns for one in fitted.parts])
    for part, at in parts_of(panel, "rows scored"):
        designs = rows.of(part)
        what = mixed(designs, thetas, fitted.mixer)
        credit[at], half[at], disagreement[at] = what.credit, fitted.factor * what.deviation, what.disagreement
        each[:, at], weights[:, at], number[at] = what.each, what.weights, part.frame.index
        own = slice(int(part.window[0]), int(part.window[-1]) + 1)
        sums[own] = aggregated(part, what.credit, panel.roles)
        if seen is not None:
            seen(part, own, designs)
    for values in (half, disagreement):
        values[values <= NOTHING * np.abs(each).max(initial=0)] = 0
    if fitted.intercept is not None:
        sums = _odds(sums, fitted.intercept)
        adding_up = np.full(count, np.nan)
    else:
        adding_up = _balanced(fitted, panel, credit, sums)
    return Scored(credit, credit - half, credit + half, adding_up, disagreement, each, weights, number), sums


def _hold_out(found: Recovered, part: Part, designs: list[Floats], columns: list[np.ndarray], out: Floats) -> None:
    """Predictions of the labels of a part's windows [M + 1, w] by fits that have not seen their fold."""
    if len(found.held) < 2:
        return
    first = int(part.window[0])
    fold = found.folds.fold[part.window]
    sums = np.zeros((len(out), len(part)))
    for number, held in enumerate(found.held):
        rows = np.flatnonzero(fold == number)
        if not len(rows):
            continue
        some = [design[rows] for design in designs]
        what = mixed(some, thetas(columns, held), found.mixer)
        sums[:-1, rows], sums[-1, rows] = what.each, what.credit
    out[:] = aggregated(part, sums.T, found.panel.roles).T
    for number, intercepts in enumerate(found.held_intercepts):  # of bits
        own = found.folds.fold[first : first + out.shape[1]] == number
        for m, intercept in enumerate([*intercepts, intercepts[0]]):  # the mixture has the reference's
            out[m, own] = _odds(out[m, own], intercept[0])


def _odds(sums: Floats, intercept: float) -> Floats:
    return 1 / (1 + np.exp(-(sums + intercept)))


def _balanced(fitted: Fitted, panel: Panel, credit: Floats, sums: Floats) -> Floats:
    windows, roles = panel.windows, panel.roles
    given = None
    if fitted.rho != 0:
        layout = Layout.of(windows.steps, windows.group, windows.labelled, roles.label_is)
        given = errors(np.where(windows.labelled, windows.label - sums, np.nan), layout, fitted.rho).rows()
    return balanced(
        credit,
        windows.label,
        windows.steps,
        roles.label_is,
        errors=given,
        nonnegative=fitted.nonnegative,
        ids=list(windows.id),
    )


def _judged(found: Recovered, fitted: Floats, held_out: Floats) -> Judged:
    windows, share = found.panel.windows, shares(found.panel)
    alike, persistent = np.full(len(windows), np.nan), np.full(len(windows), np.nan)
    for number, (_, pieces) in enumerate(found.folds.of):
        own = found.folds.fold == number
        seen = np.isin(found.folds.piece, pieces) & windows.labelled
        if not seen.any():
            continue
        rate = windows.label[seen].sum() / share[seen].sum()
        alike[own] = rate * share[own]
    previous = np.where(windows.labelled, windows.label / share, np.nan)
    last = _before(previous, windows.group)
    persistent = np.where(np.isfinite(last), last * share, alike)
    scores = np.array([[r_squared(windows.label, one, plain) for one in held_out] for plain in (alike, persistent)])
    return Judged(fitted, held_out, alike, persistent, scores)


def shares(panel: Panel) -> Floats:
    """By what a label is larger than what it tells of a row [W]: a sum by the window's rows."""
    return panel.windows.steps.astype(np.float64) if panel.roles.label_is == "sum" else np.ones(len(panel.windows))


def _before(values: Floats, group: np.ndarray) -> Floats:
    """The last value before each window in its group [W], NaN where there is none."""
    place = np.where(np.isfinite(values), np.arange(len(values)), -1)
    latest = np.maximum.accumulate(place)
    before = np.concatenate([[-1], latest[:-1]])
    good = (before >= 0) & (group[np.maximum(before, 0)] == group)
    return np.where(good, values[np.maximum(before, 0)], np.nan)


def frames(panel: Panel, names: Sequence[str], rows: Scored) -> Iterator[pd.DataFrame]:
    """The rows part by part, with what tells which they are: group, window and time, and their number as index.

    Args:
        panel: where they lie. names: of the models. rows: what is said of them.
    """
    import pandas as pd

    roles = panel.roles
    keys = [name for name in (roles.group, roles.window, roles.time) if name]
    for part, at in parts_of(panel):
        columns = {
            "credit": rows.credit[at],
            "credit_low": rows.low[at],
            "credit_high": rows.high[at],
            "credit_balanced": rows.balanced[at],
        }
        for m, name in enumerate(names):
            columns |= {f"credit_{name}": rows.each[m, at], f"weight_{name}": rows.weights[m, at]}
        columns["disagreement"] = rows.disagreement[at]
        own = part.frame[[key for key in keys if key in part.frame.columns]]
        yield pd.concat([own, pd.DataFrame(columns, index=part.frame.index)], axis=1)


def in_order(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """All rows, as they lay in what was given."""
    import pandas as pd

    return pd.concat(list(frames)).sort_index(kind="stable")


def windowed_frame(panel: Panel) -> pd.DataFrame:
    """A row a window: group, window, steps, label."""
    import pandas as pd

    windows, roles = panel.windows, panel.roles
    groups = {roles.group: [windows.groups[code] for code in windows.group]} if roles.group else {}
    return pd.DataFrame(
        {**groups, roles.window: windows.id, "steps": windows.steps, "label": windows.label}, copy=False
    )

"""What windows can tell: columns whose effects their labels tell apart, and columns and contrasts that they do not.

A linear model with the window-summed design X [W, d] says nothing of a direction v with Xv = 0. What is asked of a fit,
cᵀθ, has an answer if c is orthogonal to all of them, and gets no number otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from credit.logged.panel import INTERCEPT, Floats, Ints, Part

ROUNDING = 1e-9  # of the largest eigenvalue of the design, its columns of length 1
SMALL = 1e-6  # part of a column in a direction, that is none
WEAK = 10.0  # variance inflation from which on a column is told apart badly


@dataclass(frozen=True)
class Relation:
    """Columns whose window sums are one column, up to numbers: no label tells them apart.

    Attributes:
        columns: numbers of the columns. weights: v [d]. text: what is equal in every window.
        remedy: what would tell them apart.
    """

    columns: Ints
    weights: Floats
    text: str
    remedy: str = ""


@dataclass(frozen=True)
class Telling:
    """What the windows can tell of a design.

    Attributes:
        names: of the columns [d]. rank: of X. condition: of X, its columns of length 1, without what has no answer.
        relations: what is not told apart. inflation: by how much the others make a column's variance larger [d], NaN
            where it has no answer, and for the intercept. partner: the column that is most like it [d], −1 for none.
    """

    names: tuple[str, ...]
    rank: int
    condition: float
    relations: tuple[Relation, ...]
    inflation: Floats
    partner: Ints

    @property
    def nowhere(self) -> Floats:
        """Directions v of which nothing is known [d, k], one a relation."""
        return np.array([one.weights for one in self.relations]).T.reshape(len(self.names), -1)

    def answers(self, contrasts: Floats) -> np.ndarray:
        """Whether cᵀθ has an answer [...], for contrasts c [..., d]."""
        if not self.relations:
            return np.ones(np.shape(contrasts)[:-1], dtype=bool)
        # SMALL is against what the columns of the contrast alone would come to
        size = np.abs(contrasts) @ np.abs(self.nowhere)
        return (np.abs(contrasts @ self.nowhere) <= SMALL * np.maximum(size, 1e-300)).all(-1)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, texts and numbers, null for NaN."""
        found = {name: getattr(self, name) for name in ("names", "rank", "condition", "inflation", "partner")}
        found = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in found.items()}
        relations = [
            {"columns": one.columns.tolist(), "weights": one.weights.tolist(), "text": one.text, "remedy": one.remedy}
            for one in self.relations
        ]
        inflation = [None if np.isnan(one) else one for one in found["inflation"]]
        condition = None if np.isnan(self.condition) else self.condition
        return {**found, "condition": condition, "inflation": inflation, "relations": relations}

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Telling:
        """What was saved."""
        relations = tuple(
            Relation(
                np.array(one["columns"], np.int64), np.array(one["weights"], np.float64), one["text"], one["remedy"]
            )
            for one in saved["relations"]
        )
        condition, inflation = (np.array(saved[name], np.float64) for name in ("condition", "inflation"))
        partner = np.array(saved["partner"], np.int64)
        return cls(tuple(saved["names"]), int(saved["rank"]), float(condition), relations, inflation, partner)


def told(xx: Floats, names: Sequence[str]) -> Telling:
    """What a design can tell, by its products XᵀX [d, d] over labelled windows."""
    size = np.sqrt(np.maximum(np.diag(xx), 0))
    there = size > 0
    unit = xx / np.outer(np.where(there, size, 1), np.where(there, size, 1))
    unit[~there, ~there] = 0
    values, vectors = np.linalg.eigh(unit)
    known = values > ROUNDING * max(values[-1], 1e-300) if len(values) else np.zeros(0, dtype=bool)
    basis = _rows(vectors[:, ~known].T)
    relations = tuple(_relation(row, size, there, names) for row in basis)
    answered = ~(np.abs(basis) > SMALL).any(0) if len(basis) else np.ones(len(names), dtype=bool)
    inflation, partner = _inflation(xx, answered & there, names)
    condition = float(np.sqrt(values[known][-1] / values[known][0])) if known.any() else float("nan")
    return Telling(tuple(names), int(known.sum()), condition, relations, inflation, partner)


def _inflation(xx: Floats, answered: np.ndarray, names: Sequence[str]) -> tuple[Floats, Ints]:
    """Variance inflation of columns, the intercept taken out of them, and of each the one that is most like it."""
    if INTERCEPT in names and xx[(one := list(names).index(INTERCEPT), one)] > 0:
        xx = xx - np.outer(xx[:, one], xx[one]) / xx[one, one]
        answered = answered & (np.arange(len(names)) != one)
    own = np.flatnonzero(answered & (np.diag(xx) > 0))
    inflation, partner = np.full(len(names), np.nan), np.full(len(names), -1)
    if len(own):
        size = np.sqrt(np.diag(xx)[own])
        alike = xx[np.ix_(own, own)] / np.outer(size, size)
        inflation[own] = np.diag(np.linalg.pinv(alike, rcond=ROUNDING, hermitian=True))
        others = np.abs(alike - np.diag(np.diag(alike)))
        partner[own] = np.where(others.max(0) > 0, own[others.argmax(0)], -1)
    return inflation, partner.astype(np.int64)


def _rows(basis: Floats) -> Floats:
    """The same space by rows that have as few columns as can be: reduced by elimination, the last columns first."""
    rows, lead = basis[:, ::-1].copy(), 0
    for column in range(rows.shape[1]):
        if lead == len(rows):
            break
        best = lead + int(np.abs(rows[lead:, column]).argmax())
        if abs(rows[best, column]) <= SMALL:
            continue
        rows[[lead, best]] = rows[[best, lead]]
        rows[lead] /= rows[lead, column]
        others = np.arange(len(rows)) != lead
        rows[others] -= np.outer(rows[others, column], rows[lead])
        lead += 1
    rows = rows[:lead, ::-1]
    return np.where(np.abs(rows) > SMALL, rows, 0.0)


def _relation(row: Floats, size: Floats, there: np.ndarray, names: Sequence[str]) -> Relation:
    weights = np.where(there, row / np.where(there, size, 1), row)
    columns = np.flatnonzero(row)
    first = int(columns[-1])  # the one that elimination led with
    weights = weights / weights[first]
    if len(columns) == 1:
        return Relation(columns, weights, f"{names[first]} is 0 in every window")
    rest = [(-weights[column], names[column]) for column in columns[:-1]]
    sum_of = " + ".join(name if abs(by - 1) < SMALL else f"{by:.4g}·{name}" for by, name in rest).replace("+ -", "− ")
    return Relation(columns, weights, f"summed over every window, {names[first]} = {sum_of}")


def remedied(relation: Relation, part: Part, design: Floats, window: str) -> Relation:
    """A relation with what would tell its columns apart, by the rows of a part.

    Args:
        relation: of the columns of a design. part: rows. design: φ of them [n, d]. window: what a window is called.
    """
    along = design @ relation.weights
    size = np.abs(design) @ np.abs(relation.weights)
    scale = max(float(size.max(initial=0)), 1e-300)
    if (np.abs(along) <= SMALL * scale).all():
        what = (
            "rows in which it is not 0"
            if len(relation.columns) == 1
            else "rows in which one of them moves without the others (another action)"
        )
        return replace(relation, remedy=f"they are tied in every row, too; only {what} would tell: no other windows do")
    ends = np.append(part.starts[1:], len(part)) - 1
    inside = np.add.accumulate(along)
    before = inside[part.starts] - along[part.starts]
    partial = np.abs(inside - before[part.window - part.window[0]])
    partial[ends] = 0
    cut = int(partial.argmax())
    number = cut - int(part.starts[part.window[cut] - part.window[0]]) + 1
    steps = int(ends[part.window[cut] - part.window[0]] - part.starts[part.window[cut] - part.window[0]] + 1)
    return replace(
        relation,
        remedy=(
            f"a label for part of a {window} would tell, such as one for the first {number} of its {steps} rows; or a "
            f"{window} with a row missing"
        ),
    )

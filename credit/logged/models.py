"""Models of a step's credit on rows: a formula and how it is fitted, and what windows sum of its terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError, nearest
from credit.logged.formulas.terms import Terms
from credit.logged.panel import Floats, Ints, Panel, Part, Roles
from credit.logged.progress import watched
from credit.logged.spreading import mapped

Sign = Literal["positive", "negative"]
SIGNS = {"positive": 1, "negative": -1}
SAMPLE = 100_000  # rows by which a formula learns what columns alone do not tell


@dataclass(frozen=True)
class Model:
    """A linear model of a step's credit.

    Attributes:
        name: in tables, files and figures. terms: its formula. regularization: λ in windows; None: chosen by folds.
        signs: feature → the sign that its effect may have.
    """

    name: str
    terms: Terms
    regularization: float | None = None
    signs: Mapping[str, Sign] = field(default_factory=dict)

    def bound(self) -> dict[int, int]:
        """Column of the design → the sign of its coefficient.

        Raises:
            UserError: a sign of what is no feature of the formula.
        """
        found = dict[int, int]()
        for name, sign in self.signs.items():
            touched = self.terms.touching(name) if name in self.terms.columns else np.zeros(0, dtype=np.int64)
            if not len(touched):
                raise UserError(
                    f"{self.name}: sign of {name!r}: it is in no term of the formula; "
                    f"{nearest(name, list(self.terms.columns))}"
                )
            if sign not in SIGNS:
                raise UserError(f"{self.name}: sign of {name!r} is {sign!r}; allowed are {', '.join(SIGNS)}")
            found |= {int(column): SIGNS[sign] for column in touched}
        return found


class Designs(Protocol):
    """What rows are in the eyes of a model: terms of a formula, or the numbers of a step."""

    @property
    def names(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def stock(self) -> NDArray[np.bool_]: ...  # noqa: D102
    def design(self, part: Part, state: dict[str, Any], columns: Ints | None = None) -> Floats: ...  # noqa: D102
    def replaced(  # noqa: D102
        self, part: Part, state: dict[str, Any], column: str, value: Any, columns: Ints | None = None
    ) -> Floats: ...


class Designed(Protocol):
    """A model that has a design: linear, or registered."""

    @property
    def terms(self) -> Designs: ...  # noqa: D102


def learned(models: Sequence[Model], panel: Panel) -> list[Model]:
    """The models, with what their terms have to learn from rows: of the first that there are."""
    from dataclasses import replace

    if not any(model.terms.sampled for model in models):
        return list(models)
    part = next(panel.parts())
    keep = part.starts[part.starts < SAMPLE]
    if len(part) > SAMPLE and len(keep):
        stop = int(keep[-1]) or len(part)
        part = Part(part.frame.iloc[:stop], part.window[:stop], part.group[:stop], part.continues)
    return [replace(model, terms=model.terms.learn(part)) for model in models]


class Pass:
    """One pass over all rows, in order, with what models' terms carry from part to part.

    Args:
        panel: the rows. models: linear or registered ones, whose designs are wanted. columns: of each design, rising;
            None: all.
        replaced: a feature and the value that it has in all rows; None: as it was.
    """

    def __init__(
        self,
        panel: Panel,
        models: Sequence[Designed],
        columns: Sequence[np.ndarray | None] | None = None,
        replaced: tuple[str, Any] | None = None,
    ) -> None:
        self._panel, self._models, self._replaced = panel, models, replaced
        self._columns = columns or [None] * len(models)
        self._states: list[dict[str, Any]] = [{} for _ in models]
        self._stock = [
            model.terms.stock if own is None else model.terms.stock[own]
            for model, own in zip(models, self._columns, strict=True)
        ]

    def of(self, part: Part) -> list[Floats]:
        """φ of the next part's rows [n, d] of each model; what is a level counts by its mean over the window."""
        found = []
        for model, columns, state, stock in zip(self._models, self._columns, self._states, self._stock, strict=True):
            if self._replaced is None:
                phi = model.terms.design(part, state, columns)
            else:
                phi = model.terms.replaced(part, state, *self._replaced, columns)
            if stock.any() and self._panel.roles.label_is in ("sum", "binary"):
                phi[:, stock] /= self._panel.windows.steps[part.window, None]
            found.append(phi)
        return found


def aggregated(part: Part, values: Floats, roles: Roles) -> Floats:
    """What a label sees of values of rows [n, ...]: their sum, mean or last in each window [w, ...]."""
    if roles.label_is == "last":
        return values[np.append(part.starts[1:], len(part)) - 1]
    sums = part.sums(values)
    if roles.label_is != "mean":
        return sums
    steps = np.diff(np.append(part.starts, len(part)))
    return sums / steps.reshape(-1, *[1] * (values.ndim - 1))


def windowed(panel: Panel, models: Sequence[Designed], extra: Sequence[str] = ()) -> tuple[list[Floats], Floats]:
    """The design of windows of each model [W, D], in one pass; and of further numeric columns of the rows [W, E]."""
    found = mapped(partial(_windowed, models=models, extra=extra), panel)
    if len(found) == 1:
        return found[0]
    every, further = zip(*found, strict=True)
    return [np.concatenate(parts) for parts in zip(*every, strict=True)], np.concatenate(further)


def _windowed(panel: Panel, models: Sequence[Designed], extra: Sequence[str]) -> tuple[list[Floats], Floats]:
    count = len(panel.windows)
    found = [np.empty((count, len(model.terms.names))) for model in models]
    further = np.empty((count, len(extra)))
    rows = Pass(panel, models)
    for part in watched(panel, "windows summed"):
        own = slice(int(part.window[0]), int(part.window[-1]) + 1)
        for whole, phi in zip(found, rows.of(part), strict=True):
            whole[own] = aggregated(part, phi, panel.roles)
        if extra:
            further[own] = aggregated(part, part.frame[list(extra)].to_numpy(np.float64), panel.roles)
    return found, further


def parts_of(panel: Panel, what: str = "rows read") -> Iterator[tuple[Part, slice]]:
    """Every part, with the places of its rows among all, in order; `what` is done to them."""
    first = 0
    for part in watched(panel, what):
        yield part, slice(first, first + len(part))
        first += len(part)

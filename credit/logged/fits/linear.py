"""Linear models of a step's credit, fitted to labels of windows: the point fit and every draw, each with its own λ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from credit.core.errors import UserError
from credit.logged.fits.choosing import Reduced
from credit.logged.fits.folds import Folds
from credit.logged.fits.moments import Moments, moments
from credit.logged.fits.ridge import LAMBDAS, held_out, rounded, signed, solutions
from credit.logged.fits.units import Units
from credit.logged.panel import INTERCEPT, Floats, Ints
from credit.logged.progress import tell

SWEEPS = 2  # over the terms whose parameters are chosen
LARGEST = 3 * 10**8  # numbers in the moments of all draws


class Free(Protocol):
    """A term whose parameters are chosen: for each candidate the columns of the design that stand for it; and the call
    whose decay may lie between its candidates' `decays`, "" for none."""

    @property
    def text(self) -> str: ...  # noqa: D102
    @property
    def candidates(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def columns(self) -> Sequence[Ints]: ...  # noqa: D102
    @property
    def call(self) -> str: ...  # noqa: D102
    @property
    def decays(self) -> Sequence[float]: ...  # noqa: D102


class Choices(Protocol):
    """What a model's design offers: columns that are always there, and terms of which one candidate each is chosen."""

    @property
    def names(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def fixed(self) -> Ints: ...  # noqa: D102
    @property
    def choices(self) -> Sequence[Free]: ...  # noqa: D102
    def chosen(self, choice: Sequence[int] | Ints) -> Ints: ...  # noqa: D102


@dataclass(frozen=True)
class LinearFit:
    """A model that was fitted; the point fit is the first of 1 + B.

    Attributes:
        theta: [1 + B, D], 0 for columns that were not chosen. penalty: λ of each [1 + B]. chosen: the candidate of each
            free term [1 + B, terms]. errors: Σ over folds of squared errors of labels of the point fit, at its λ.
    """

    theta: Floats
    penalty: Floats
    chosen: Ints
    errors: float

    def columns(self, choices: Choices, fit: int = 0) -> Ints:
        """Which columns of the design are in a fit."""
        return choices.chosen(self.chosen[fit])

    def used(self, choices: Choices) -> Ints:
        """Which columns of the design are in some fit."""
        every = [choices.chosen(choice) for choice in np.unique(self.chosen, axis=0)]
        return np.unique(np.concatenate(every)).astype(np.int64)

    def coefficient(self, choices: Choices, column: int) -> Floats:
        """What the term of a column is multiplied by in every fit [1 + B], whichever candidate it chose there."""
        found = self.theta[:, column].copy()
        for at, free in enumerate(choices.choices):
            places = np.flatnonzero(free.columns[self.chosen[0, at]] == column)
            if len(places):
                own = np.array([one[places[0]] if places[0] < len(one) else column for one in free.columns])
                found = self.theta[np.arange(len(found)), own[self.chosen[:, at]]]
        return found


def intercept_of(choices: Choices) -> int | None:
    """The column that is 1 in every row, where there is one."""
    return next((number for number, name in enumerate(choices.names) if name == INTERCEPT), None)


@dataclass(frozen=True)
class Fitting:
    """How models are fitted to windows.

    Args:
        folds: on which λ and parameters of terms are chosen. units: what draws weigh. draws: B. seed: of the draws.
    """

    folds: Folds
    units: Units | None
    draws: int = 0
    seed: int = 0

    def moments(self, x: Floats, y: Floats, known: np.ndarray) -> Moments:
        """Of every piece of the folds, in every fit [pieces, 1 + B], from labelled windows alone."""
        fits = 1 + self.draws
        if (numbers := self.folds.pieces * fits * x.shape[1] ** 2) > LARGEST:
            raise UserError(
                f"a model has {x.shape[1]} columns with those of all candidates; with {self.draws} draws and "
                f"{len(self.folds.of)} folds its moments are {numbers:.1e} numbers, at most {LARGEST:.0e} are kept; "
                "use fewer draws or folds, fewer candidates (adstock(x, [.3, .6])), or categories with fewer values"
            )
        unit = np.zeros(len(y), dtype=np.int64) if self.units is None else self.units.of
        where = np.flatnonzero(known)

        def weights(units: Ints) -> Floats:
            if self.units is None:
                return np.ones((len(units), 1))
            return self.units.weights(units, self.draws, self.seed)

        return moments(x[where], y[where], self.folds.piece[where], unit[where], weights, self.folds.pieces, fits)

    def fit(
        self,
        choices: Choices,
        pieces: Moments,
        regularization: float | None = None,
        signs: Mapping[int, int] | None = None,
    ) -> LinearFit:
        """Choose candidates and λ in every fit by contiguous folds, and solve it.

        Args:
            choices: of the model. pieces: moments [pieces, 1 + B]. regularization: λ; None: chosen.
            signs: column → +1 or −1, the sign that its effect may have.
        """
        penalties = LAMBDAS if regularization is None else np.array([float(regularization)])
        free = intercept_of(choices)
        fits = pieces.yy.shape[1]
        chosen = np.zeros((fits, len(choices.choices)), dtype=np.int64)
        theta, penalty, first = np.zeros((fits, pieces.xy.shape[-1])), np.zeros(fits), 0.0
        if choices.choices and len(self.folds.of) > 1:
            chosen[0], held = self._choose(choices, pieces[:, 0], penalties, free, chosen[0].tolist())
            for fit in range(1, fits):  # draws begin where the fit to all ended
                chosen[fit], _ = self._choose(choices, pieces[:, fit], penalties, free, chosen[0].tolist(), held)
                tell("draws fitted", fit + 1, fits)
        for choice in np.unique(chosen, axis=0):  # all fits with the same columns at once
            own = np.flatnonzero((chosen == choice).all(1)).astype(np.int64)
            columns = choices.chosen(choice)
            inside = _place(columns, free)
            part = pieces.of(columns, own)
            errors = held_out(*self.folds.apart(part), penalties, inside) if len(self.folds.of) > 1 else None
            plain = len(penalties) // 2 if regularization is None else 0  # there is nothing to try it on
            best = np.full(len(own), plain) if errors is None else np.asarray(errors).argmin(-1)
            penalty[own] = penalties[best]
            if own[0] == 0 and errors is not None:
                first = float(errors[0, best[0]])
            theta[own[:, None], columns] = _solved(part.sum(0), penalty[own], columns, inside, signs)
        return LinearFit(theta, penalty, chosen, first)

    def without(
        self,
        choices: Choices,
        pieces: Moments,
        fit: LinearFit,
        fold: int,
        draws: int,
        signs: Mapping[int, int] | None = None,
    ) -> Floats:
        """θ [1 + draws, D] of the first fits, with their λ and candidates, without a fold and what touches it."""
        theta = np.zeros((1 + draws, pieces.xy.shape[-1]))
        free = intercept_of(choices)
        for choice in np.unique(fit.chosen[: 1 + draws], axis=0):
            own = np.flatnonzero((fit.chosen[: 1 + draws] == choice).all(1)).astype(np.int64)
            columns = choices.chosen(choice)
            every = pieces.of(columns, own)
            part, place = every[self.folds.of[fold][1]].sum(0), _place(columns, free)
            theta[own[:, None], columns] = _solved(part, fit.penalty[own], columns, place, signs, every.sum(0))
        return theta

    def _choose(
        self,
        choices: Choices,
        pieces: Moments,
        penalties: Floats,
        free: int | None,
        begin: Sequence[int],
        penalty: float | None = None,
    ) -> tuple[list[int], float]:
        """The candidate of each term, one term after the other, that predicts labels best which were held out; and λ.

        Args:
            pieces: moments of one fit. begin: candidates to begin with. penalty: λ; None: that which is best for the
                candidates so far, in each of several sweeps.
        """
        fitted, tested = self.folds.apart(pieces)
        chosen, before = list(begin), list[int]()
        for _ in range(SWEEPS if penalty is None else 1):
            best = penalty
            if best is None:
                columns = choices.chosen(chosen)
                at = held_out(fitted.of(columns), tested.of(columns), penalties, _place(columns, free)).argmin()
                best = float(penalties[at])
            errors = _errors(fitted, tested, choices, best, free)
            for term, one in enumerate(choices.choices):
                others = [at.columns[chosen[k]] for k, at in enumerate(choices.choices) if k != term]
                chosen[term] = int(np.argmin(errors([np.concatenate([*others, own]) for own in one.columns])))
            if chosen == before:
                break
            before = list(chosen)
        assert best is not None
        return chosen, best


def _errors(
    fitted: Moments, tested: Moments, choices: Choices, penalty: float, free: int | None
) -> Callable[[list[Ints]], Floats]:
    """Σ over folds of squared errors, as a function of the columns of candidates beside those that are fixed."""
    fixed = np.asarray(choices.fixed)
    if penalty > 0 and (free is None or free in fixed):
        reduced = Reduced.of(fitted, tested, fixed, penalty, free)

        def few(candidates: list[Ints]) -> Floats:
            if len({len(one) for one in candidates}) == 1:
                return reduced.errors(np.stack(candidates))
            return np.array([reduced.errors(one[None])[0] for one in candidates])

        return few

    def whole(candidates: list[Ints]) -> Floats:
        found = []
        for one in candidates:
            columns = np.unique(np.concatenate([fixed, one])).astype(np.int64)
            parts = fitted.of(columns), tested.of(columns)
            found.append(held_out(*parts, np.array([penalty]), _place(columns, free))[0])
        return np.array(found)

    return whole


def _solved(
    moments: Moments,
    penalty: Floats,
    columns: Ints,
    free: int | None,
    signs: Mapping[int, int] | None,
    whole: Moments | None = None,
) -> Floats:
    """θ [F, d] of fits with the same columns; `whole` are the moments of all windows, where these are some."""
    theta = solutions(moments, penalty[:, None], free, whole)[:, 0]
    if signs and (bound := np.array([signs.get(int(column), 0) for column in columns])).any():
        for number in range(len(theta)):
            own = None if whole is None else whole[number]
            theta[number] = signed(moments[number], penalty[number], free, bound, own)
    return rounded(theta, moments)


def _place(columns: Ints, free: int | None) -> int | None:
    """Where the intercept is among some columns."""
    places = [] if free is None else np.flatnonzero(np.atleast_2d(columns)[0] == free).tolist()
    return places[0] if places else None

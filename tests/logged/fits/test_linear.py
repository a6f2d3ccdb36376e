"""Folds with a gap; fits of all draws against fits one by one; terms whose parameters are chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.fits.folds import folds_of, r_squared
from credit.logged.fits.linear import Fitting, LinearFit
from credit.logged.fits.moments import Moments
from credit.logged.fits.ridge import LAMBDAS, solutions
from credit.logged.fits.units import Units
from tests.logged.fits.test_units import windows


@dataclass
class Term:
    text: str
    candidates: list[str]
    columns: list[np.ndarray]


@dataclass
class Design:
    names: list[str]
    fixed: np.ndarray
    choices: list[Term] = field(default_factory=list)

    def chosen(self, choice: Sequence[int] | np.ndarray) -> np.ndarray:
        return np.unique(
            [*self.fixed, *(c for term, at in zip(self.choices, choice, strict=True) for c in term.columns[at])]
        )


def design(size: int) -> Design:
    return Design(["Intercept", *(f"x{i}" for i in range(1, size))], np.arange(size))


def plain(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> Moments:
    return Moments((x * w[:, None]).T @ x, x.T @ (w * y), (w * y) @ y, w.sum())


def made(groups: int, times: int, size: int = 4) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    x = random.normal(size=(groups * times, size))
    x[:, 0] = 7
    return x, x @ np.arange(1.0, size + 1) + random.normal(size=groups * times)


def test_folds_are_contiguous_and_what_touches_them_is_left_out() -> None:
    some = windows(3, 50)
    found = folds_of(some, 5, gap=2)
    assert found.gap == 2
    for k, (tested, fitted) in enumerate(found.of):
        inside = np.unique(some.time[np.isin(found.piece, tested)])
        assert inside.tolist() == list(range(10 * k, 10 * k + 10))
        outside = np.unique(some.time[np.isin(found.piece, fitted)])
        assert outside.tolist() == [t for t in range(50) if t < 10 * k - 2 or t >= 10 * k + 12]


def test_few_times_make_few_folds() -> None:
    assert len(folds_of(windows(2, 7), 5, 3).of) == 3
    assert len(folds_of(windows(2, 1), 5, 3).of) == 1
    assert folds_of(windows(1, 10), 5, 3).gap == 0


def test_r_squared_is_against_a_plain_prediction() -> None:
    y = np.array([1.0, 2, 3, np.nan])
    assert r_squared(y, np.array([1.0, 2, 2, 5]), np.full(4, 2.0)) == 0.5
    assert np.isnan(r_squared(y, y, y))


def test_every_draw_is_fitted_to_its_own_weights_with_its_own_penalty() -> None:
    x, y = made(4, 40)
    some = windows(4, 40)
    known = np.ones(160, dtype=bool)
    known[5] = False
    units = Units("blocks", some.time // 4, np.arange(10, dtype=np.uint64), 4, 0, 0, "")
    fitting = Fitting(folds_of(some, 4, 1), units, draws=6, seed=3)
    found = fitting.fit(design(4), fitting.moments(x, np.where(known, y, np.nan), known))
    weights = units.weights(units.of, 6, 3)
    for fit in range(7):
        errors = np.zeros(len(LAMBDAS))
        for tested, fitted in fitting.folds.of:
            inside = np.isin(fitting.folds.piece, fitted) & known
            outside = np.isin(fitting.folds.piece, tested) & known
            both = inside | outside  # by what columns are scaled
            whole = plain(x[both], y[both], weights[both, fit])
            theta = solutions(plain(x[inside], y[inside], weights[inside, fit]), LAMBDAS, 0, whole)
            errors += (weights[outside, fit] * (y[outside] - theta @ x[outside].T) ** 2).sum(-1)
        assert found.penalty[fit] == LAMBDAS[errors.argmin()]
        wanted = solutions(plain(x[known], y[known], weights[known, fit]), found.penalty[fit : fit + 1], 0)[0]
        np.testing.assert_allclose(found.theta[fit], wanted, rtol=1e-8)
    assert found.errors == pytest.approx(min(errors) if fit == 0 else found.errors)


def test_a_given_penalty_is_that_of_every_fit() -> None:
    x, y = made(2, 30)
    fitting = Fitting(folds_of(windows(2, 30), 3, 0), None)
    found = fitting.fit(design(4), fitting.moments(x, y, y > -1e9), regularization=2.5)
    np.testing.assert_allclose(found.theta[0], solutions(plain(x, y, np.ones(60)), np.array([2.5]), 0)[0], rtol=1e-9)


def test_the_parameters_of_terms_are_those_that_predict_best() -> None:
    x, y = made(3, 60, size=7)
    y = 2 * x[:, 0] + 3 * x[:, 2] - 2 * x[:, 6] + 0.3 * np.random.default_rng(1).normal(size=180)
    terms = [
        Term("a", ["0", "1", "2"], [np.array([1]), np.array([2]), np.array([3])]),
        Term("b", ["0", "1"], [np.array([4, 5]), np.array([5, 6])]),
    ]
    some = windows(3, 60)
    units = Units("blocks", some.time // 6, np.arange(10, dtype=np.uint64), 6, 0, 0, "")
    fitting = Fitting(folds_of(some, 5, 1), units, draws=5)
    shape = Design(["Intercept", *"234567"], np.array([0]), terms)
    found = fitting.fit(shape, fitting.moments(x, y, y > -1e9))
    assert found.chosen.tolist() == [[1, 1]] * 6
    assert found.columns(shape).tolist() == [0, 2, 5, 6]
    assert not found.theta[:, [1, 3, 4]].any()
    np.testing.assert_allclose(found.theta[0, [0, 2, 5, 6]], [2, 3, 0, -2], atol=0.1)


def test_signs_bind_every_draw() -> None:
    x, y = made(3, 60)
    some = windows(3, 60)
    units = Units("blocks", some.time // 6, np.arange(10, dtype=np.uint64), 6, 0, 0, "")
    fitting = Fitting(folds_of(some, 5, 1), units, draws=5)
    found = fitting.fit(design(4), fitting.moments(x, y, y > -1e9), signs={2: -1})
    assert (found.theta[:, 2] <= 1e-12).all()
    assert (found.theta[:, 3] > 0).all()


def test_more_than_fits_into_memory_is_refused() -> None:
    x = np.ones((10, 2000))
    fitting = Fitting(
        folds_of(windows(1, 10), 2, 0), Units("blocks", np.arange(10), np.arange(10, dtype=np.uint64), 1, 0, 0, ""), 200
    )
    with pytest.raises(UserError, match="2000 columns"):
        fitting.moments(x, x[:, 0], x[:, 0] > 0)


def test_what_a_fold_hardly_sees_predicts_nothing_wild() -> None:
    """A column that is almost nothing outside of the fold that tests it: its coefficient is held back, not blown up."""
    some = windows(1, 60)
    random = np.random.default_rng(4)
    x = np.stack(
        [np.full(60, 7.0), random.normal(size=60), np.where(np.arange(60) < 12, 1.0, 1e-8 * random.normal(size=60))],
        axis=1,
    )
    y = x[:, 0] + x[:, 1] + 5 * (np.arange(60) < 12) + 0.1 * random.normal(size=60)
    fitting = Fitting(folds_of(some, 5, 0), None)
    pieces = fitting.moments(x, y, np.ones(60, dtype=bool))
    fit = fitting.fit(design(3), pieces)
    without = fitting.without(design(3), pieces, fit, 0, 0)[0]
    assert np.abs(x[:12] @ without - y[:12]).max() < 20


def test_a_coefficient_is_that_of_its_term_whichever_candidate_a_fit_chose() -> None:
    terms = [Term("a", ["a0", "a1"], [np.array([3, 1]), np.array([2, 4])])]  # x3 and x2, x1 and x4 are the same
    theta = np.array([[1, 5, 0, 6, 0, 9], [2, 0, 7, 0, 8, 9], [3, 1, 0, 2, 0, 9.0]])
    fit = LinearFit(theta, np.ones(3), np.array([[0], [1], [0]]), 0.0)
    offered = Design(["Intercept", "x1", "x2", "x3", "x4", "z"], np.array([0, 5]), terms)
    wanted = {0: [1, 2, 3], 1: [5, 8, 1], 3: [6, 7, 2], 5: [9, 9, 9]}
    assert {column: fit.coefficient(offered, column).tolist() for column in wanted} == wanted

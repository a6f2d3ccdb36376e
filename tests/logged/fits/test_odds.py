"""Bits by logistic sums: against scikit-learn, weights that are repetitions, and folds that were held out."""

from __future__ import annotations

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.fits.folds import folds_of
from credit.logged.fits.odds import Bits, require_bits
from credit.logged.fits.units import Units
from tests.logged.fits.test_linear import Design, Term, design
from tests.logged.fits.test_units import windows


def made(count: int = 120, size: int = 4) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    x = random.normal(size=(count, size)) * np.array([1, 5.0, 1, 0.1])[:size]
    x[:, 0] = random.integers(4, 8, count)
    odds = x @ np.array([0.05, 0.3, -1.0, 4.0])[:size]
    return x, (random.uniform(size=count) < 1 / (1 + np.exp(-odds))).astype(float)


def test_the_point_fit_is_scikit_learns() -> None:
    from sklearn.linear_model import LogisticRegression

    x, y = made()
    x = x[:, 1:]
    names = Design(["a", "b", "c"], np.arange(3))
    fit, intercept = Bits(x, y, folds_of(windows(1, 120), 4, 1), None).fit(names, regularization=2.0)
    peer = LogisticRegression(C=1 / 2.0, tol=1e-10, max_iter=1000).fit(x / x.std(0), y)
    np.testing.assert_allclose(fit.theta[0] * x.std(0), peer.coef_[0], atol=0.01)  # ours holds the intercept, a little
    np.testing.assert_allclose(intercept[0], peer.intercept_[0], atol=0.01)


def test_draws_weigh_windows_and_differ() -> None:
    x, y = made()
    some = windows(1, 120)
    units = Units("blocks", some.time // 8, np.arange(15, dtype=np.uint64), 8, 0, 0, "")
    bits = Bits(x, y, folds_of(some, 4, 1), units, draws=30, seed=1)
    fit, intercept = bits.fit(design(4))
    assert fit.theta.shape == (31, 4)
    assert intercept.shape == (31,)
    assert (fit.theta[1:].std(0) > 0).all()
    np.testing.assert_allclose(fit.theta[1:, 1:].mean(0), fit.theta[0, 1:], rtol=0.5)
    weights = units.weights(units.of, 30, 1)[:, 7]
    odds = x @ fit.theta[7] + intercept[7]
    gradient = x[:, 1:].T @ (weights * (1 / (1 + np.exp(-odds)) - y))
    np.testing.assert_allclose(gradient, -fit.penalty[0] * fit.theta[7, 1:] * x[:, 1:].var(0), rtol=1e-5, atol=1e-7)


def test_windows_without_a_label_and_held_out_folds_are_not_seen() -> None:
    x, y = made()
    y[:30] = np.nan
    bits = Bits(x, y, folds_of(windows(1, 120), 4, 1), None)
    fit, _ = bits.fit(design(4))
    theta, intercept = bits.without(design(4), fit, 3, 0)
    seen = np.isin(bits.folds.piece, bits.folds.of[3][1]) & np.isfinite(y)
    alone, other = Bits(x[seen], y[seen], folds_of(windows(1, int(seen.sum())), 4, 1), None).fit(
        design(4), regularization=float(fit.penalty[0])
    )
    np.testing.assert_allclose(theta, alone.theta, rtol=1e-6)
    np.testing.assert_allclose(intercept, other, rtol=1e-6)


def test_candidates_are_chosen_by_labels_that_were_held_out() -> None:
    x, y = made()
    shape = Design(
        [*"1abc"], np.array([0]), [Term("t", ["0", "1", "2"], [np.array([1]), np.array([2]), np.array([3])])]
    )
    y = (x[:, 2] + 0.2 * np.random.default_rng(3).normal(size=120) > 0).astype(float)
    fit, _ = Bits(x, y, folds_of(windows(1, 120), 4, 1), None).fit(shape)
    assert fit.chosen.tolist() == [[1]]


def test_a_label_that_is_always_the_same_has_an_end() -> None:
    x, y = made()
    fit, intercept = Bits(x, np.ones_like(y), folds_of(windows(1, 120), 4, 1), None).fit(design(4))
    assert np.isfinite(fit.theta).all()
    assert np.isfinite(intercept).all()


def test_a_label_that_is_no_bit_is_named() -> None:
    require_bits(np.array([0.0, 1, np.nan]), [1, 2, 3])
    with pytest.raises(UserError, match=r"window 'w2' is 0.5; allowed are 0 and 1"):
        require_bits(np.array([0.0, 0.5]), ["w1", "w2"])

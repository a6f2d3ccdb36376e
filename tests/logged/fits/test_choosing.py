"""Errors of candidates against whole fits of them."""

from __future__ import annotations

import numpy as np
import pytest

from credit.logged.fits.choosing import Reduced
from credit.logged.fits.moments import Moments
from credit.logged.fits.ridge import held_out, scales
from tests.logged.fits.test_moments import plain, stacked


def folds(intercept: bool) -> tuple[Moments, Moments]:
    """Of three folds, with 9 columns: the first is that of an intercept, the fourth does not vary."""
    random = np.random.default_rng(1)
    x = random.normal(size=(90, 9)) * np.arange(1, 10) + 3
    x[:, 0] = 7
    x[:, 3] = 7 if intercept else 0
    y = x @ random.normal(size=9) + random.normal(size=90)
    w = random.exponential(size=90)
    where = [np.arange(90) // 30 == k for k in range(3)]
    fitted = stacked([plain(x[~one], y[~one], w[~one]) for one in where])
    return fitted, stacked([plain(x[one], y[one], w[one]) for one in where])


@pytest.mark.parametrize("intercept", [True, False])
@pytest.mark.parametrize("penalty", [1e-3, 2.0, 1e4])
def test_errors_are_those_of_whole_fits(intercept: bool, penalty: float) -> None:
    fitted, tested = folds(intercept)
    always, free = np.array([0, 2, 3, 5]), 0 if intercept else None
    reduced = Reduced.of(fitted, tested, always, penalty, free)
    candidates = np.array([[1, 4], [6, 4], [8, 7]])
    wanted = []
    for own in candidates:
        columns = np.concatenate([always, own])
        parts = fitted.of(columns), tested.of(columns)
        wanted.append(held_out(*parts, np.array([penalty]), free)[0])
    np.testing.assert_allclose(reduced.errors(candidates), wanted, rtol=1e-8)


def test_scales_are_deviations_where_there_is_an_intercept() -> None:
    random = np.random.default_rng(0)
    x = random.normal(size=(50, 3)) * [1, 2, 3] + 5
    x[:, 0] = 4
    moments = plain(x, x[:, 1], np.ones(50))
    np.testing.assert_allclose(scales(moments, 0), [0, *x[:, 1:].std(0)], rtol=1e-9)
    np.testing.assert_allclose(scales(moments, None), np.sqrt((x**2).mean(0)), rtol=1e-12)

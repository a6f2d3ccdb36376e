"""Splines and polynomials as polynomials between breaks, against formulaic's."""

from __future__ import annotations

import ast
import json
from typing import Any

import numpy as np
import pytest
from formulaic.transforms import basis_spline, natural_cubic_spline, poly

from credit.core.errors import UserError
from credit.logged.formulas import bases
from credit.logged.panel import Floats

RANDOM = np.random.default_rng(8)
X = RANDOM.gamma(2.0, 10.0, 400)
BEYOND = np.array([X.min() - 50, X.min() - 1e-6, X.min(), X.max(), X.max() + 1e-6, X.max() + 300])


def made(text: str, x: Floats, points: Floats = X) -> Floats:
    tree = ast.parse(text, mode="eval").body
    learned = json.loads(json.dumps(bases.learn(tree, points, points.min(), points.max())))
    values = np.empty((len(x), bases.size(tree)), order="F")
    bases.fill(learned, x, values)
    return values


@pytest.mark.parametrize(("df", "degree"), [(3, 3), (4, 3), (9, 3), (1, 1), (4, 2), (7, 5)])
def test_bs_is_formulaics_and_a_constant_beyond(df: int, degree: int) -> None:
    known: dict[str, Any] = {}
    wanted = [basis_spline(x, df, None, degree, extrapolation="clip", _state=known) for x in (X, BEYOND)]
    for x, each in zip((X, BEYOND), wanted, strict=True):
        np.testing.assert_allclose(made(f"bs(x, {df}, {degree})", x), np.stack([*each.values()], 1), atol=1e-11)


@pytest.mark.parametrize("df", [3, 4, 8])
@pytest.mark.parametrize("name", ["cr", "cs"])
def test_cr_is_formulaics_and_a_straight_line_beyond(name: str, df: int) -> None:
    known: dict[str, Any] = {}
    wanted = [natural_cubic_spline(x, df, _state=known) for x in (X, BEYOND)]
    for x, each in zip((X, BEYOND), wanted, strict=True):
        np.testing.assert_allclose(made(f"{name}(x, {df})", x), np.stack([*each.values()], 1), atol=1e-10)


@pytest.mark.parametrize("degree", [1, 2, 5, 10])
def test_poly_is_formulaics(degree: int) -> None:
    known: dict[str, Any] = {}
    for x in (X, BEYOND[1:5]):
        wanted = poly(x, degree, _state=known)
        np.testing.assert_allclose(made(f"poly(x, {degree})", x), wanted, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("points", [np.r_[np.zeros(60), np.arange(1.0, 41)], np.r_[np.zeros(90), np.arange(1.0, 3)]])
@pytest.mark.parametrize("text", ["bs(x, 5)", "cr(x, 5)"])
def test_where_most_values_are_the_same_no_two_knots_are(text: str, points: Floats) -> None:
    values = made(text, np.linspace(0, points.max(), 300), points)
    whole = np.column_stack([np.ones(300), values[:, int(text.startswith("cr")) :]])
    assert np.linalg.matrix_rank(whole) == whole.shape[1]


def test_a_column_with_one_value_has_no_curve() -> None:
    with pytest.raises(UserError, match=r"bs\(x, 4\): x is 3 in all rows, and a curve needs different values"):
        made("bs(x, 4)", X, np.full(21, 3.0))

"""Splines and polynomials: fixed once, from quantiles or a sample, as polynomials between breaks.

What a basis is, `formulaic` says, at as many places between two breaks as a polynomial needs. From then on rows cost a
loop, and a model that was saved needs no package. Beyond all values bs goes on as a constant, cr and cs as a straight
line, poly as itself.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas import carry
from credit.logged.formulas.safety import called, numbers
from credit.logged.panel import Floats


def size(tree: ast.expr) -> int:
    """Columns of a basis: bs, cr and cs have df, poly has degree."""
    return int(numbers(tree)[0])


def spans_one(tree: ast.expr) -> bool:
    """Whether its columns add up to 1, as those of a category do, so that one goes where there is an intercept."""
    return called(tree) in ("cr", "cs")


def learn(tree: ast.expr, points: Floats, least: float, most: float) -> dict[str, Any]:
    """What is fixed of a basis.

    Args:
        tree: its call. points: values or quantiles of them, which say where inner knots lie. least, most: of all.

    Returns:
        breaks [m + 1] and coefficients [m, k, degree + 1] of `carry.piecewise`, as lists.

    Raises:
        UserError: all values are the same.
    """
    from formulaic.transforms import basis_spline, natural_cubic_spline, poly

    name, (first, *more) = called(tree), numbers(tree)
    if not least < most:
        assert isinstance(tree, ast.Call)
        text = ast.unparse(tree.args[0])
        raise UserError(f"{ast.unparse(tree)}: {text} is {least:g} in all rows, and a curve needs different values")
    whole = np.array([least, most])
    if name == "poly":
        known: dict[str, Any] = {}
        poly(points, int(first), _state=known)
        return _pieces(lambda x: np.asarray(poly(x, int(first), _state=known)), whole, int(first))
    beyond = np.array([2 * least - most, 2 * most - least])
    if name == "bs":
        degree = int(more[0])
        knots = _knots(points, int(first) - degree, whole)
        keys = {"knots": knots, "degree": degree, "lower_bound": least, "upper_bound": most, "extrapolation": "clip"}
        return _pieces(lambda x: _columns(basis_spline(x, **keys)), np.sort([*beyond, *whole, *knots]), degree)
    knots = _knots(np.unique(points), int(first) - 2, whole)
    keys = {"knots": knots, "lower_bound": least, "upper_bound": most}
    return _pieces(lambda x: _columns(natural_cubic_spline(x, **keys)), np.sort([*beyond, *whole, *knots]), 3)


def fill(learned: dict[str, Any], x: Floats, values: Floats) -> None:
    """The columns of a basis [n, k] at values [n]."""
    carry.piecewise(
        np.ascontiguousarray(x, np.float64),
        np.asarray(learned["breaks"], np.float64),
        np.asarray(learned["coefficients"], np.float64),
        values,
    )


def _knots(points: Floats, count: int, whole: Floats) -> list[float]:
    """Inner knots at quantiles; where many values are the same, at those of different ones, or evenly."""
    share = np.linspace(0, 1, count + 2)[1:-1]
    for inner in (np.quantile(points, share), np.quantile(np.unique(points), share)):
        if np.all(np.diff([whole[0], *inner, whole[1]]) > 1e-9 * (whole[1] - whole[0])):
            return [float(each) for each in inner]
    return [float(each) for each in whole[0] + share * (whole[1] - whole[0])]


def _pieces(basis: Callable[[Floats], Floats], breaks: Floats, degree: int) -> dict[str, Any]:
    """A basis that is polynomials of a degree between breaks, by its values at Chebyshev's points."""
    t = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    x = (breaks[:-1, None] + breaks[1:, None] + np.diff(breaks)[:, None] * t) / 2
    values = basis(x.ravel()).reshape(*x.shape, -1)  # [m, degree + 1, k]
    coefficients = np.linalg.solve(np.vander(t, increasing=True), values)
    return {"breaks": breaks.tolist(), "coefficients": coefficients.swapaxes(1, 2).tolist()}


def _columns(values: Any) -> Floats:
    return np.stack(list(values.values()), axis=-1)

"""Carry-over against loops that anyone can read, whatever the parts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from credit.logged.formulas import carry
from credit.logged.formulas.carry import NOTHING
from credit.logged.panel import Floats

RANDOM = np.random.default_rng(3)
GROUP = np.repeat([0, 1, 2, 3], [9, 1, 12, 3])
X = RANDOM.normal(size=len(GROUP)).round(3)
CUTS = [(0, 25), (0, 4, 25), (0, 2, 3, 5, 9, 10, 14, 15, 21, 25), tuple(range(26))]


def lagged(k: int, stock: bool) -> list[float]:
    values = []
    for g in np.unique(GROUP):
        rows = X[g == GROUP].tolist()
        start = rows[0] if stock else 0.0
        values += ([start] * k + rows)[: len(rows)]
    return values


def adstocked(decay: float) -> list[float]:
    return [
        sum(decay**age * x for age, x in enumerate(X[: i + 1][GROUP[: i + 1] == GROUP[i]][::-1])) for i in range(len(X))
    ]


def in_parts(cuts: tuple[int, ...], of: str, number: float, **more: bool) -> Floats:
    before, parts = NOTHING, []
    for first, last in pairwise(cuts):
        if first and GROUP[first] != GROUP[first - 1]:
            before = NOTHING
        values, before = getattr(carry, of)(X[first:last], number, GROUP[first:last], before, **more)
        parts.append(values)
    return np.concatenate(parts)


@pytest.mark.parametrize("cuts", CUTS)
@pytest.mark.parametrize("stock", [False, True])
@pytest.mark.parametrize("k", [0, 1, 2, 3, 7, 30])
def test_a_lag_is_the_value_before_in_the_group(k: int, stock: bool, cuts: tuple[int, ...]) -> None:
    assert in_parts(cuts, "lag", k, stock=stock).tolist() == lagged(k, stock)


@pytest.mark.parametrize("cuts", CUTS)
@pytest.mark.parametrize("decay", [0.0, 0.3, 0.95])
def test_adstock_is_a_sum_of_what_is_left(decay: float, cuts: tuple[int, ...]) -> None:
    np.testing.assert_allclose(in_parts(cuts, "adstock", decay), adstocked(decay), rtol=1e-12)


def test_a_part_without_rows_leaves_what_it_was_given() -> None:
    none, before = np.empty(0), np.array([2.0])
    for of in (carry.lag, carry.adstock):
        values, left = of(none, 1, GROUP[:0], before)
        assert (len(values), left.tolist()) == (0, [2.0])


def test_pieces_are_polynomials_from_break_to_break_and_go_on_beyond() -> None:
    breaks, coefficients = np.array([0.0, 2.0, 6.0]), np.array([[[1.0, 1.0]], [[0.0, 3.0]]])
    x = np.array([-1.0, 0.0, 1.0, 2.0, 5.0, 8.0])
    values = np.empty((6, 1), order="F")
    carry.piecewise(x, breaks, coefficients, values)
    assert values[:, 0].tolist() == [-1.0, 0.0, 1.0, -3.0, 1.5, 6.0]

"""Candidates of what was left open."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.formulas.free import choices, free_calls, together
from credit.logged.formulas.terms import Terms
from credit.logged.panel import Column
from tests.logged.formulas.rows import ROLES

HALF_ZERO = np.concatenate([np.zeros(10), np.linspace(0, 100, 11)])  # quantiles 0, …, .5 are 0
COLUMNS = {
    "tv": Column("tv", None, False, 1.0, 1.0, 0.0, 100.0, tuple(HALF_ZERO)),
    "x": Column("x", most=1.0),
    "never": Column("never", quantiles=(0.0,) * 21),
}


def of(formula: str) -> Terms:
    return Terms.of(formula, COLUMNS, ROLES)


def test_halves_are_quantiles_of_what_is_above_0() -> None:
    (free,) = of("saturate(tv)").choices
    halves = [float(text.removeprefix("saturate(tv, ").rstrip(")")) for text in free.candidates]
    np.testing.assert_allclose(halves, [25, 50, 75, 90], rtol=0.01)


def test_halves_of_what_is_carried_over_are_of_what_it_comes_to() -> None:
    (free,) = of("saturate(adstock(tv))").choices
    assert len(free.candidates) == 24
    halves = [float(text.rpartition(", ")[2].rstrip(")")) for text in free.candidates if "tv, 0.8" in text]
    np.testing.assert_allclose(halves, [5 * 25, 5 * 50, 5 * 75, 5 * 90], rtol=0.01)
    (some,) = of("saturate(adstock(tv, [.5, .6]), [10, 20])").choices
    assert some.candidates[1:3] == ("saturate(adstock(tv, 0.5), 20)", "saturate(adstock(tv, 0.6), 10)")


def test_lags_are_0_to_3() -> None:
    assert of("lag(tv) + x").choices[0].candidates == tuple(f"lag(tv, {k})" for k in range(4))


def test_free_calls_are_found_wherever_they_stand() -> None:
    tree = ast.parse("log1p(saturate(adstock(tv) + lag(x, [1, 2]), 3)) / adstock(tv)", mode="eval").body
    assert free_calls(tree) == {"adstock(tv)": 6, "lag(x, [1, 2])": 2}


def test_terms_are_linked_by_others() -> None:
    assert together([["a"], [], ["b"], ["c"], ["a", "b"]]) == [[0, 2, 4], [3]]
    assert [*choices({"a": 2, "b": 1})] == [{"a": 0, "b": 0}, {"a": 1, "b": 0}]


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("saturate(never)", "never is nowhere above 0"),
        ("saturate(adstock(tv)):saturate(adstock(x)):lag(tv):lag(x)", "9216 candidates.* 5000 are the most"),
    ],
)
def test_what_cannot_be_chosen_is_said(formula: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        of(formula)


def test_a_decay_alone_says_its_call_whatever_its_column_is_called() -> None:
    columns = {"size of it": Column("size of it", most=1.0), "x": Column("x", most=1.0)}
    (free,) = Terms.of("1 + adstock(`size of it`)", columns, ROLES).choices
    assert free.decays[0] == 0
    refined = Terms.of("1 + adstock(`size of it`)", columns, ROLES).refined({free.call: (0.1, 0.2, 0.3)})
    assert [one.rpartition(", ")[2] for one in refined.choices[0].candidates] == ["0.1)", "0.2)", "0.3)"]
    for formula in ("1 + adstock(x, [.1, .2])", "1 + saturate(adstock(x))", "1 + lag(x)"):
        assert [one.call for one in Terms.of(formula, columns, ROLES).choices] == [""]

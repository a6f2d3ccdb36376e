"""What may stand in a formula, and that nothing else gets anywhere."""

from __future__ import annotations

import ast

import pytest

from credit.core.errors import UserError
from credit.logged.formulas.safety import features, numbers, read
from credit.logged.formulas.terms import Terms
from credit.logged.panel import Column
from tests.logged.formulas.rows import ROLES, columns, table

COLUMNS = {**columns(table()), "x": Column("x", most=1.0), "é": Column("é", most=1.0), "`": Column("`", most=1.0)}


def known(name: str, place: int) -> bool:
    return COLUMNS[name].levels is not None


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("adstock(tv,decay=.5)", "adstock(tv, 0.5)"),
        ("adstock( tv )", "adstock(tv)"),
        ("adstock(tv, [.2, .20, 0.8])", "adstock(tv, [0.2, 0.8])"),
        ("lag(tv, [3])", "lag(tv, 3)"),
        ("saturate(adstock(tv, .5), half = 100)", "saturate(adstock(tv, 0.5), 100)"),
        ("bs(x)", "bs(x)"),
        ("bs(x, 4, degree=3)", "bs(x, 4)"),
        ("bs(x, degree=2)", "bs(x, 2, 2)"),
        ("poly(x, 1)", "poly(x)"),
        ("(x +\n é) ** -2", "(x + é) ** (-2)"),
        ("log(`size of it`*é)", "log(`size of it` * é)"),
        ("`x`", "x"),
        ("C(region)", "C(region)"),
        ("  +x - 1e3", "+x - 1000.0"),
    ],
)
def test_one_form_for_what_is_the_same(text: str, form: str) -> None:
    assert ast.unparse(read(text, 0, known)) == form


def test_what_is_in_a_factor() -> None:
    tree = read("bs(log(tv + x)*tv/`size of it`, 5, 2)", 0, known)
    assert set(features(tree)) == {"tv", "x", "size of it"}
    assert numbers(tree) == (5, 2)
    assert numbers(read("bs(tv)", 0, known)) == (3, 3)


@pytest.mark.parametrize(
    ("formula", "place", "said"),
    [
        ("x + x.real", 5, "'x.real', at character 5, is no feature"),  # a name with a dot in formulaic's grammar
        ("x + {x.real}", 6, "'x.real', at character 6, is no arithmetic"),
        ("x + log(x.real)", 9, "is no arithmetic"),
        ("x + x[0]", 5, "'x[0]', at character 5, is no arithmetic"),
        ("log(é*x[0])", 7, "'x[0]'"),  # characters, not bytes
        ("log(`size of it` + x[0])", 20, "'x[0]'"),
        ("log(x.__class__)", 5, "'x.__class__'"),
        ("I(().__class__.__bases__)", 3, "is no arithmetic"),
        ("{lambda: x}", 2, "'lambda: x'"),
        ("I([x for x in x])", 3, "is no arithmetic"),
        ("{(x := 3)}", 3, "is no arithmetic"),
        ("log('x')", 5, "\"'x'\""),
        ("log(f'{x}')", 5, "is no arithmetic"),
        ("x + 'abc'", 5, "'abc', at character 5, is no number"),
        ("C(region, contr.sum)", 1, "is to be C(x)"),
        ("C(region, levels='a')", 18, "is given as levels"),
        ("C(region + 1)", 3, "is no feature, and C takes one"),
        ("x + __import__('os')", 5, "'__import__', at character 5, is no function"),
        ("open('f')", 1, "'open', at character 1, is no function"),
        ("x - eval(x)", 5, "'eval'"),  # although it would be taken away from the formula
        ("np.log(x)", 1, "'np.log(x)', at character 1, is no arithmetic"),
        ("Q('x')", 1, "'Q'"),
        ("hashed(x)", 1, "'hashed'"),
        ("lgo(x)", 1, "did you mean 'log'"),
        ("x + True", 5, "'True', at character 5, is no feature"),
        ("{True}", 2, "is no arithmetic"),
        ("{1j}", 2, "is no arithmetic"),
        ("{x > 3}", 2, "'x > 3'"),
        ("{x @ x}", 2, "'x @ x'"),
        ("{x // 2}", 2, "'x // 2'"),
        ("{x and x}", 2, "is no arithmetic"),
        ("I(*x)", 1, "is to be I(x)"),
        ("log(**x)", 7, "is given as None"),
        ("log(x, x)", 1, "is to be log(x)"),
        ("log()", 1, "is to be log(x)"),
        ("log(region)", 5, "'region', at character 5, is a category"),
        ("log(C(region))", 5, "C stands by itself"),
        ("adstock(bs(x, 4), .5)", 9, "bs stands by itself"),
        ("poly(x, 11)", 9, "is no degree, which is a whole number from 1 to 10"),
        ("bs(x, 2)", 1, "df is at least 3"),
        ("cr(x)", 1, "needs df: cr(x, df)"),
        ("bs(x, [4, 5])", 7, "is no df"),
        ("adstock(x, 1)", 12, "'1', at character 12, is no decay, which is from 0 to less than 1"),
        ("adstock(x, -.5)", 12, "is no decay"),
        ("adstock(x, x)", 12, "is no decay"),
        ("adstock(x, [.5, x])", 17, "is no decay"),
        ("adstock(x, [])", 12, "is no decay"),
        ("lag(x, 1.5)", 8, "is no k, which is a whole number"),
        ("lag(x, True)", 8, "is no k"),
        ("lag(x, window=2)", 15, "is given as window, and lag(x, k) is what there is"),
        ("saturate(x, 0)", 13, "is no half, which is above 0"),
        ("log(x +)", 8, "cannot be read"),
        ("log(x", 1, "before quote context was closed"),
        ("I(" + "-" * 100 + "x)", 63, "is too deep"),
        ("{" + "9" * 400 + "}", 2, "is no arithmetic"),
        ("9" * 400 + ":x", 1, "is no number"),
    ],
)
def test_all_else_is_refused_with_its_place(formula: str, place: int, said: str) -> None:
    with pytest.raises(UserError) as caught:
        Terms.of(formula, COLUMNS, ROLES)
    assert said in str(caught.value)
    assert f"at character {place}" in str(caught.value)
    assert repr(formula) in str(caught.value)


@pytest.mark.parametrize("formula", ["log(" * 3000 + "x" + ")" * 3000, "{" + "+".join(["x"] * 5000) + "}"])
def test_what_is_nested_too_deeply_ends_with_a_word(formula: str) -> None:
    with pytest.raises(UserError, match=r"cannot be read|too deep"):
        Terms.of(formula, COLUMNS, ROLES)

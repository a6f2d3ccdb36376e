"""Designs against formulaic's own model matrix and loops that anyone can read, whatever the parts."""

from __future__ import annotations

import json
import pickle
import sys
from typing import Any

import formulaic
import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.formulas.terms import Terms
from credit.logged.panel import Column, Floats, Roles
from tests.logged.formulas.rows import GROUPS, ROLES, N, columns, part, parts, table

TABLE = table()
COLUMNS = columns(TABLE)
FUNCTIONS = {name: getattr(np, name) for name in ("sqrt", "abs", "sin", "cos", "tanh", "log1p")}


def of(formula: str | None, **stock: Any) -> Terms:
    return Terms.of(formula, columns(TABLE, **stock), ROLES)


def design(terms: Terms, cuts: tuple[int, ...] = (0, N)) -> Floats:
    state: dict[str, Floats] = {}
    return np.concatenate([terms.design(each, state) for each in parts(TABLE, cuts)])


def span(x: Floats) -> Floats:
    """The projection on the columns, which is what a fit sees of them."""
    return x @ np.linalg.pinv(x)


@pytest.mark.parametrize(
    "formula",
    [
        "1 + tv + region",
        "0 + region",
        "region*open",
        "open:region - 1",
        "price*region + tv",
        "2.5:price:region",
        "tv/price",
        "`size of it` + {`size of it`**2} + exp(`size of it`)",
        "log(price) + I(tv / 2 - 1) + sqrt(tv) + {-tv + 3}",
        "abs(`size of it`) + sin(day):cos(day) + tanh(price) + log1p(tv)",
        "C(region) + C(open):price",
        "C(day)",
        "bs(price, 4)",
        "bs(day, 6):region",
        "bs(price, df=5, degree=2) + bs(price)",
        "bs(log(price), 4)",
        "0 + cr(price, 5)",
        "0 + cs(price, df=3) + tv",
        "poly(price, 3):tv",
        "poly(price, degree=2) + center(price) + scale(tv)",
        ". + tv:price",
        "(tv + price + region)**2",
        "1",
    ],
)
def test_columns_are_those_of_formulaic(formula: str) -> None:
    frame = TABLE.assign(day=TABLE["day"].astype(int)) if "C(day)" in formula else TABLE
    wanted = formulaic.model_matrix(formula, frame, context=FUNCTIONS)
    terms = of(formula)
    if "=" not in formula:
        assert terms.names == tuple(wanted.columns)
    np.testing.assert_allclose(design(terms), np.asarray(wanted, float), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(design(terms, (0, 3, 4, 15, N)), np.asarray(wanted, float), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    "formula", ["1 + cr(price, 5)", "cs(price, 4):tv + tv", "standardize(price)", "cr(day, 4)*open"]
)
def test_what_it_spans_is_what_formulaic_spans_without_columns_that_are_sums_of_others(formula: str) -> None:
    wanted, values = np.asarray(formulaic.model_matrix(formula, TABLE), float), design(of(formula))
    np.testing.assert_allclose(span(values), span(wanted), atol=1e-8)
    assert np.linalg.matrix_rank(values) == values.shape[1]


def test_no_formula_is_an_intercept_and_every_feature(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = formulaic.model_matrix("1 + tv + radio + price + day + `size of it` + region + open", TABLE)
    monkeypatch.setitem(sys.modules, "formulaic", None)
    terms = of(None)
    assert terms.names == tuple(wanted.columns)
    assert terms.fixed.tolist() == [*range(len(terms.names))]
    np.testing.assert_array_equal(design(terms), np.asarray(wanted, float))
    with pytest.raises(UserError, match="pip install 'credit-rl\\[formula\\]'"):
        of("tv")


def adstocked(x: Floats, decay: float) -> Floats:
    values, left = [], 0.0
    for i in range(N):
        left = x[i] + decay * left * (i > 0 and GROUPS[i] == GROUPS[i - 1])
        values.append(left)
    return np.array(values)


def lagged(x: Floats, k: int, stock: bool = False) -> Floats:
    values = []
    for i in range(N):
        rows = np.flatnonzero(GROUPS[: i + 1] == GROUPS[i])
        values.append(x[i - k] if i - k >= rows[0] else x[rows[0]] if stock else 0.0)
    return np.array(values)


@pytest.mark.parametrize("cuts", [(0, N), (0, 10, 14, N), (0, 1, 5, 6, 7, 12, 13, 20, N), tuple(range(N + 1))])
def test_what_is_carried_over_passes_windows_and_parts_and_no_groups(cuts: tuple[int, ...]) -> None:
    tv, price = (TABLE[name].to_numpy() for name in ("tv", "price"))
    terms = of(
        "0 + adstock(tv, .5) + lag(tv, 2) + saturate(adstock(tv, .5), 100) + log1p(lag(tv, 1))"
        " + adstock(lag(tv, 1), .3) + lag(price, 3) + adstock(tv, .5):price + lag(I(tv*price), k=1)",
        stock=("price",),
    )
    left = adstocked(tv, 0.5)
    wanted = [left, lagged(tv, 2), left / (left + 100), np.log1p(lagged(tv, 1)), adstocked(lagged(tv, 1), 0.3)]
    wanted += [lagged(price, 3, stock=True), lagged(tv * price, 1), left * price]
    assert terms.names[2] == "saturate(adstock(tv, 0.5), 100)"
    np.testing.assert_allclose(design(terms, cuts), np.stack(wanted, 1), rtol=1e-12)


def test_a_part_that_goes_on_from_nothing_begins_anew() -> None:
    terms, state = of("0 + adstock(tv, .5)"), dict[str, Floats]()
    first, second = parts(TABLE, (0, 5, 10))
    alone = terms.design(second, {})
    terms.design(first, state)
    assert alone[0, 0] == TABLE["tv"].iloc[5] != terms.design(second, state)[0, 0]


@pytest.mark.parametrize("cuts", [(0, N), (0, 5, 6, 12, N)])
@pytest.mark.parametrize(("column", "value"), [("tv", 0), ("tv", 7.5), ("region", "a"), ("open", "False"), ("day", 30)])
def test_replaced_is_the_design_of_a_table_in_which_it_was_so(cuts: tuple[int, ...], column: str, value: Any) -> None:
    terms = of("1 + saturate(adstock(tv, .5), 30):price + region*open + lag(tv, 1) + bs(day, 4) + radio")
    changed = TABLE.assign(**{column: value})
    if isinstance(TABLE[column].dtype, pd.CategoricalDtype):
        changed[column] = pd.Categorical(
            [False if value == "False" else value] * N, categories=terms.columns[column].levels
        )
    state, other, own = dict[str, Floats](), dict[str, Floats](), dict[str, Floats]()
    for each, wanted in zip(parts(TABLE, cuts), parts(changed, cuts), strict=True):
        values = terms.replaced(each, state, column, value)
        np.testing.assert_array_equal(values, terms.design(wanted, other))
        same = np.setdiff1d(np.arange(len(terms.names)), terms.touching(column))
        np.testing.assert_array_equal(values[:, same], terms.design(each, own)[:, same])
    with pytest.raises(UserError, match=r"'z' is no value of region; \(valid: a, b, c\)"):
        terms.replaced(part(TABLE), {}, "region", "z")
    with pytest.raises(UserError, match="'much' is no number, and tv is one"):
        terms.replaced(part(TABLE), {}, "tv", "much")


def test_some_columns_are_those_of_the_whole() -> None:
    terms = of("1 + region*open + adstock(tv) + bs(price, 5)")
    whole = design(terms)
    for some in (np.array([0, 3]), terms.chosen([4]), np.array([len(terms.names) - 2]), np.arange(2, 9)):
        values = np.concatenate([terms.design(each, state, some) for state in [{}] for each in parts(TABLE, (0, 6, N))])
        np.testing.assert_array_equal(values, whole[:, some])
    assert whole.flags.f_contiguous


def test_stock_is_what_is_made_of_levels_alone() -> None:
    terms = of("1 + price + day + price:day + log(price):tv + bs(day, 3) + I(price + tv)", stock=("price", "day"))
    levels = dict(zip(terms.names, terms.stock.tolist(), strict=True))
    assert {name for name, stock in levels.items() if not stock} == {"Intercept", "log(price):tv", "I(price + tv)"}
    assert Terms.of("price", COLUMNS, Roles("w", "y", states=("price",), stock=("price",))).stock.tolist() == [
        False,
        True,
    ]


def test_free_terms_are_chosen_by_columns_of_one_design() -> None:
    terms = of("1 + price + adstock(tv) + lag(radio, [1, 2])")
    assert [free.text for free in terms.choices] == ["adstock(tv)", "lag(radio, [1, 2])"]
    assert terms.choices[0].candidates == tuple(f"adstock(tv, {decay})" for decay in (0, 0.2, 0.4, 0.6, 0.8, 0.9))
    assert [terms.names[at] for at in terms.fixed] == ["Intercept", "price"]
    picked = terms.chosen([3, 1])
    assert [terms.names[at] for at in picked] == ["Intercept", "price", "adstock(tv, 0.6)", "lag(radio, 2)"]
    fixed = of("1 + price + adstock(tv, .6) + lag(radio, 2)")
    assert not fixed.choices
    np.testing.assert_array_equal(design(terms)[:, picked], design(fixed))


def test_factors_of_a_product_are_chosen_together() -> None:
    terms = of("adstock(tv, [.1, .5])*adstock(radio, [0, .3, .6]) + adstock(price, [.2, .4]):region")
    both, alone = terms.choices
    assert len(both.candidates) == 6
    assert both.text == "adstock(tv, [0.1, 0.5]), adstock(radio, [0, 0.3, 0.6])"
    at = both.candidates.index("adstock(tv, 0.5), adstock(radio, 0.3)")
    names = [terms.names[column] for column in both.columns[at]]
    assert sorted(names) == ["adstock(radio, 0.3)", "adstock(tv, 0.5)", "adstock(tv, 0.5):adstock(radio, 0.3)"]
    assert len(terms.names) == len(set(terms.names)) == 1 + 2 + 3 + 6 + 2 * 3
    assert [len(each) for each in alone.columns] == [3, 3]
    x = design(terms)
    one, two, product = (x[:, terms.names.index(name)] for name in (names[0], names[1], names[2]))
    np.testing.assert_array_equal(product, one * two)


def test_the_same_free_call_is_one_parameter() -> None:
    terms = of("adstock(tv) + adstock(tv):price + log1p(adstock(tv))")
    (free,) = terms.choices
    assert len(free.candidates) == 6
    names = [terms.names[at] for at in free.columns[2]]
    assert names == ["adstock(tv, 0.4)", "log1p(adstock(tv, 0.4))", "adstock(tv, 0.4):price"]


def test_what_is_saved_comes_back() -> None:
    for formula in (
        None,
        "tv - price - region",
        "bs(price, 4)*region + saturate(adstock(tv)) + bs(adstock(tv, .5), 4) + . + C(open)",
    ):
        terms = of(formula, stock=("day",)).learn(part(TABLE))
        saved = json.loads(json.dumps(terms.to_dict()))
        for again in (Terms.from_dict(saved), pickle.loads(pickle.dumps(terms))):
            assert again.names == terms.names
            assert [free.candidates for free in again.choices] == [free.candidates for free in terms.choices]
            assert again.stock.tolist() == terms.stock.tolist()
            np.testing.assert_array_equal(design(again), design(terms))
    saved["formula"] = "__import__('os')"
    with pytest.raises(UserError, match="no function that may be used"):
        Terms.from_dict(saved)


def test_new_rows_need_not_be_prepared() -> None:
    terms = of("region + open + price")
    rows = pd.DataFrame({"price": [1, 2], "open": ["False", "True"], "region": ["c", "a"]}, index=[7, 8])
    wanted = pd.DataFrame({"region": list("ca"), "open": [False, True], "price": [1.0, 2.0]})
    assert terms.design(part(rows), {}).tolist() == [[1, 0, 1, 0, 1], [1, 0, 0, 1, 2]]
    np.testing.assert_array_equal(terms.design(part(wanted), {}), terms.design(part(rows), {}))
    with pytest.raises(UserError, match=r"region is 'd' in row 8, which is none of its values"):
        terms.design(part(rows.assign(region=["a", "d"])), {})
    with pytest.raises(UserError, match=r"there is no column 'price'; did you mean 'prize'"):
        terms.design(part(rows.rename(columns={"price": "prize"})), {})


def test_a_row_that_is_no_number_is_named() -> None:
    zero = TABLE.assign(price=TABLE["price"].where(TABLE.index != 4, 0.0))
    for formula, said in {
        "log(price)": "log(price) is -inf in row 4, where price is 0",
        "tv + {tv/price}": "tv / price is inf in row 4, where tv is",
        "bs(1/price, 3)": "1 / price is inf in row 4",
        "saturate(I(price - 1), 2)": "I(price - 1) is -1 in row 4, and saturate",
        "{exp(1e3)}": "exp(1000.0) is inf in row 0; a formula",
    }.items():
        with pytest.raises(UserError) as caught:
            of(formula).design(part(zero), {})
        assert said in str(caught.value)


def test_numbers_that_are_no_category_are_named() -> None:
    with pytest.raises(UserError, match=r"C\(price\): price is a number from .* bs\(price, 4\)"):
        of("C(price)")
    with pytest.raises(UserError, match=r"day is 3.5 in row 0, which is none of its values"):
        of("C(day)").design(part(TABLE.assign(day=3.5)), {})


def test_a_design_that_is_too_large_is_refused() -> None:
    many = {f"x{i}": Column(f"x{i}", levels=tuple(range(150))) for i in range(2)}
    with pytest.raises(UserError, match="more than 10000 columns"):
        Terms.of("x0:x1", many, ROLES)


def test_nothing_stands_in_the_design_before_it_is_learned() -> None:
    terms = of("bs(adstock(tv, .5), 4) + center(I(tv*price))")
    assert terms.sampled
    assert not of("bs(tv, 4) + center(log1p(tv))").sampled
    with pytest.raises(ValueError, match=r"terms\.learn\(part\)"):
        design(terms)
    known = terms.learn(part(TABLE))
    frame = TABLE.assign(left=adstocked(TABLE["tv"].to_numpy(), 0.5))
    wanted = formulaic.model_matrix("bs(left, 4) + center(I(tv*price))", frame)
    np.testing.assert_allclose(design(known), np.asarray(wanted, float), rtol=1e-9, atol=1e-9)
    some = terms.learn(next(parts(TABLE, (0, 8))))
    assert np.isfinite(design(some)).all()  # values beyond those of the sample
    np.testing.assert_array_equal(design(some), design(some, (0, 3, 11, N)))

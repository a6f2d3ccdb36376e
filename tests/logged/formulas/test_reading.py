"""What is said of texts that are no formula."""

from __future__ import annotations

import pytest

from credit.core.errors import UserError
from credit.logged.formulas.reading import parse
from credit.logged.formulas.terms import Terms
from credit.logged.panel import Column, Roles
from tests.logged.formulas.rows import columns, table

COLUMNS = columns(table())
ROLES = Roles("week", "sales", "date", "shop", actions=("tv",), states=("price", "region"))


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        (" ", "nothing in it"),
        ("0", "no term in it"),
        ("tv +", "at character 4: '\\+'"),
        ("tv + (price", "at character 6"),
        ("tv price", "at character"),
        ("tv + prise", "'prise', at character 6, is no feature; did you mean 'price'"),
        ("tv + `size of`", "'size of', at character 6, is no feature; did you mean 'size of it'"),
        ("tv + sales", "'sales', at character 6, is the label, which the formula explains"),
        ("tv + week", "names the windows"),
        ("tv + date", r"is the time; to use it, name it among the features, data.states=\[date\]"),
        ("shop", "is the group"),
        ("sales ~ tv", "'sales', at character 1, is the label"),
        ("price ~ tv", "several formulas"),
        ("tv | price", "several formulas"),
        ("tv**2", r"\{tv\*\*2\} or I\(tv\*\*2\)"),
        ("(tv + price)**9", "at most 5"),
        ("*".join(["tv", "price", "radio", "day"] * 10), "more than 10000 terms"),
        ("3 + tv", "(?i)numeric literals"),
        ("tv:.:price", None),
    ],
)
def test_what_is_no_formula_is_refused(formula: str, said: str | None) -> None:
    if said is None:
        assert Terms.of(formula, COLUMNS, ROLES).names
        return
    with pytest.raises(UserError, match=said) as caught:
        Terms.of(formula, COLUMNS, ROLES)
    assert repr(formula) in str(caught.value)


def test_names_may_be_anything_between_backticks() -> None:
    odd = {name: Column(name, most=1.0) for name in ("a:b", "class", "1st", "x + y", "log(x)", "x")}
    terms = Terms.of("`a:b` + `class` + `1st` + `x + y`:`log(x)` + log(`x + y`) + {`class`**2}", odd, ROLES)
    assert set(terms.names) == {"Intercept", "a:b", "class", "1st", "x + y:log(x)", "log(`x + y`)", "`class` ** 2"}


def test_what_is_written_in_two_ways_is_one_term() -> None:
    scoped, trees = parse("lag(tv, 1) + lag(tv, k=1) + {tv*2} + {2*tv}", COLUMNS, ROLES)
    assert [*trees] == ["lag(tv, 1)", "tv * 2", "2 * tv"]
    assert len(scoped) == 4


@pytest.mark.thorough
def test_a_sum_of_a_thousand_features_is_read() -> None:
    many = {f"x{i}": Column(f"x{i}", most=1.0) for i in range(1000)}
    assert len(Terms.of(" + ".join(many), many, ROLES).names) == 1001

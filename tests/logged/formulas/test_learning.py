"""What is fixed once, and from what."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.logged.formulas import learning
from credit.logged.panel import Column


def tree(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


FLAT = Column("flat", mean=2.0, least=2.0, most=2.0, quantiles=(2.0,) * 21)
STEEP = Column("x", None, False, 5.0, 2.5, 0.0, 10.0, tuple(np.linspace(0, 10, 21)))
COLUMNS = {"x": STEEP, "flat": FLAT}


def test_a_column_is_fixed_by_what_all_rows_say() -> None:
    known = learning.from_columns([tree("scale(x)"), tree("center(x)"), tree("lag(center(I(x**2)), 1)")], COLUMNS)
    assert known["scale(x)"] == {"center": 5.0, "scale": 2.5}
    assert known["center(x)"] == {"center": 5.0, "scale": 1.0}
    assert known["center(I(x ** 2))"]["center"] == pytest.approx(100 / 3, rel=0.01)


@pytest.mark.parametrize(
    ("text", "needs"), [("center(x)", False), ("bs(log1p(x), 4)", False), ("bs(lag(x, 1), 4)", True)]
)
def test_what_needs_rows(text: str, needs: bool) -> None:
    (call,) = learning.calls([tree(text)])
    assert learning.needs_rows(call) == needs
    assert (ast.unparse(call) in learning.from_columns([tree(text)], COLUMNS)) != needs


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scale(flat)", r"flat is 2 in all rows, and cannot be scaled; center\(flat\)"),
        ("bs(flat, 4)", "flat is 2 in all rows"),
        ("center(3)", "there is no feature in it"),
        ("center(log(x))", r"log\(x\) is not finite everywhere"),
    ],
)
def test_what_cannot_be_fixed_is_said(text: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        learning.from_columns([tree(text)], COLUMNS)

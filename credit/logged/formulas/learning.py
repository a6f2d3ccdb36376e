"""What a formula fixes once, for all parts and for new rows: means, deviations, knots."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas import bases
from credit.logged.formulas.compute import Learned, Source
from credit.logged.formulas.quantiles import Quantiles
from credit.logged.formulas.safety import BASES, CARRIED, LEARNED, called, column, features
from credit.logged.panel import Column


def calls(trees: Iterable[ast.expr]) -> Iterator[ast.Call]:
    """The calls that fix something, the inner ones of each factor first, each text once."""
    found = dict[str, ast.Call]()
    for tree in trees:
        for node in reversed(list(ast.walk(tree))):
            if isinstance(node, ast.Call) and called(node) in (*BASES, *LEARNED):
                found.setdefault(ast.unparse(node), node)
    yield from found.values()


def needs_rows(tree: ast.Call) -> bool:
    """Whether quantiles of its columns do not tell: what is carried over, or of several columns."""
    inner = tree.args[0]
    return len(features(inner)) > 1 or any(
        called(node) in CARRIED for node in ast.walk(inner) if isinstance(node, ast.expr)
    )


@np.errstate(all="ignore")  # what is not finite is said
def from_columns(trees: Iterable[ast.expr], columns: Mapping[str, Column]) -> dict[str, Learned]:
    """What the columns tell: of each call of a function of one column, its text → what is fixed.

    Raises:
        UserError: a call without a feature; all values are the same.
    """
    learned = dict[str, Learned]()
    for tree in calls(trees):
        if needs_rows(tree):
            continue
        inner = tree.args[0]
        if not features(inner):
            raise UserError(
                f"{ast.unparse(tree)}: there is no feature in it, and it needs one that differs from row to row"
            )
        source = Quantiles(columns, exact=isinstance(inner, ast.Name))
        source.learned = learned
        values = source.values(inner)
        _require_finite(tree, values)
        least, most, mean, deviation = values.min(), values.max(), values.mean(), values.std()
        if isinstance(inner, ast.Name):
            one = columns[column(inner)]
            least, most, mean, deviation = one.least, one.most, one.mean, one.deviation
        learned[ast.unparse(tree)] = _learn(tree, values, float(least), float(most), float(mean), float(deviation))
    return learned


@np.errstate(all="ignore")  # what is not finite is said
def from_rows(trees: Iterable[ast.expr], source: Source) -> None:
    """Learn the others from rows, into what the source has learned.

    Raises:
        UserError: all values are the same.
    """
    assert isinstance(source.learned, dict)
    for tree in calls(trees):
        if needs_rows(tree):
            values = source.values(tree.args[0])
            _require_finite(tree, values)
            known = _learn(
                tree, values, *(float(each) for each in (values.min(), values.max(), values.mean(), values.std()))
            )
            source.learned[ast.unparse(tree)] = known


def _learn(tree: ast.Call, values: np.ndarray, least: float, most: float, mean: float, deviation: float) -> Learned:
    if called(tree) in BASES:
        return bases.learn(tree, values, least, most)
    if called(tree) == "center":
        return {"center": mean, "scale": 1.0}
    if not deviation > 0:
        text = ast.unparse(tree.args[0])
        raise UserError(f"{ast.unparse(tree)}: {text} is {mean:g} in all rows, and cannot be scaled; center({text})")
    return {"center": mean, "scale": deviation}


def _require_finite(tree: ast.Call, values: np.ndarray) -> None:
    if not np.isfinite(values).all():
        text = ast.unparse(tree.args[0])
        raise UserError(f"{ast.unparse(tree)}: {text} is not finite everywhere; another function, or other rows")

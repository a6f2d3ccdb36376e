"""Parameters of carry-over that were left open: which candidates there are, and what a formula is with one of each.

adstock(tv) and adstock(tv, [.2, .5]) are free. A call that is written twice is one parameter; parameters that meet in a
term are chosen together, among the products of their candidates.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas.quantiles import Quantiles
from credit.logged.formulas.safety import PARAMETERS, called
from credit.logged.panel import Column, Ints

DECAYS = (0, 0.2, 0.4, 0.6, 0.8, 0.9)
LAGS = (0, 1, 2, 3)
SHARES = (0.25, 0.5, 0.75, 0.9)  # of the values above 0: at which of them an effect is half of its most
MOST = 5000  # candidates of what is chosen together

Choice = Mapping[str, int]  # text of a free call → number of its candidate


@dataclass(frozen=True)
class Free:
    """What is chosen together.

    Attributes:
        text: factors, as the formula has them. candidates: the same with numbers. columns: of the design, one array a
            candidate, what is the same but for its number at the same place of each; candidates may share some.
        call: text of the one decay that is chosen here, where numbers between its candidates can be tried; else "".
        decays: those of the candidates, rising, where there is such a call.
    """

    text: str
    candidates: tuple[str, ...]
    columns: tuple[Ints, ...]
    call: str = ""
    decays: tuple[float, ...] = ()


def free_calls(tree: ast.expr) -> dict[str, int]:
    """Text of each free call in a tree, the inner ones first → how many candidates it has."""
    found = dict[str, int]()
    for node in reversed([node for node in ast.walk(tree) if isinstance(node, ast.expr)]):
        name = called(node)
        if isinstance(node, ast.Call) and name and any(one.free for one in PARAMETERS[name]):
            given = node.args[1] if len(node.args) > 1 else None
            if isinstance(given, ast.List):
                found[ast.unparse(node)] = len(given.elts)
            elif given is None:
                found[ast.unparse(node)] = len({"lag": LAGS, "adstock": DECAYS}.get(name, SHARES))
    return found


def left_open(name: str, call: str, trees: Iterable[ast.expr]) -> bool:
    """Whether a call in some trees is of this function, with no number and no list where its parameter stands."""
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return any(called(node) == name and len(node.args) == 1 and ast.unparse(node) == call for node in nodes)


def tried(tree: ast.expr, decays: Mapping[str, Sequence[float]]) -> ast.expr:
    """A tree where a decay that was left open has these candidates: text of its call → numbers."""
    match tree:
        case ast.BinOp(left=left, op=op, right=right):
            return ast.BinOp(tried(left, decays), op, tried(right, decays))
        case ast.UnaryOp(op=sign, operand=operand):
            return ast.UnaryOp(sign, tried(operand, decays))
        case ast.Call(func=function, args=[inner, *given]):
            if (numbers := decays.get(ast.unparse(tree))) is not None:
                given = [ast.List([ast.Constant(number) for number in numbers])]
            return ast.Call(function, [tried(inner, decays), *given], [])
    return tree


def together(terms: Sequence[Iterable[str]]) -> list[list[int]]:
    """Numbers of the terms that share a free call, or are linked by others that do; in order of the first of each."""
    groups: list[tuple[set[str], list[int]]] = []
    for at, calls in enumerate(terms):
        names, members = set(calls), [at]
        if not names:
            continue
        for group in [group for group in groups if group[0] & names]:
            groups.remove(group)
            names, members = names | group[0], [*group[1], *members]
        groups.append((names, sorted(members)))
    return sorted(group for _, group in groups)


def choices(calls: Mapping[str, int]) -> Iterator[Choice]:
    """Every candidate of every call with every other's.

    Raises:
        UserError: there are too many.
    """
    count = int(np.prod([float(each) for each in calls.values()]))
    if count > MOST:
        raise UserError(
            f"{', '.join(calls)} stand in one product, so that {count} candidates are to be tried, and {MOST} are the "
            "most; write some of the numbers, adstock(tv, .5), or short lists, adstock(tv, [.2, .6])"
        )
    for each in product(*map(range, calls.values())):
        yield dict(zip(calls, each, strict=True))


def concrete(tree: ast.expr, choice: Choice, columns: Mapping[str, Column]) -> ast.expr:
    """A tree with a number in the place of each free parameter.

    Raises:
        UserError: what is to be saturated has no values above 0.
    """
    match tree:
        case ast.BinOp(left=left, op=op, right=right):
            return ast.BinOp(concrete(left, choice, columns), op, concrete(right, choice, columns))
        case ast.UnaryOp(op=sign, operand=operand):
            return ast.UnaryOp(sign, concrete(operand, choice, columns))
        case ast.Call(func=function, args=[inner, *given]):
            within, at = concrete(inner, choice, columns), choice.get(ast.unparse(tree))
            if at is not None:
                given = [
                    given[0].elts[at]
                    if given and isinstance(given[0], ast.List)
                    else _default(tree, within, at, columns)
                ]
            return ast.Call(function, [within, *given], [])
    return tree


def _default(tree: ast.expr, inner: ast.expr, at: int, columns: Mapping[str, Column]) -> ast.expr:
    match called(tree):
        case "lag":
            return ast.Constant(LAGS[at])
        case "adstock":
            return ast.Constant(DECAYS[at])
    with np.errstate(all="ignore"):  # what is not finite is left out
        values = np.atleast_1d(Quantiles(columns, exact=False).values(inner))
    above = values[np.isfinite(values) & (values > 0)]
    if not len(above):
        raise UserError(
            f"{ast.unparse(tree)}: {ast.unparse(inner)} is nowhere above 0, so that there is nothing to saturate"
        )
    half = float(f"{np.quantile(above, SHARES[at]):.4g}")
    return ast.Constant(int(half) if half == int(half) else half)

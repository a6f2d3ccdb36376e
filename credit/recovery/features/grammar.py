"""What the package `formulaic` says of a formula, which is shown no data and runs nothing: terms, ranks, errors."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from credit.core.errors import UserError

POWER = 5  # largest power of terms: (s + a)**5; what is written out grows with it as powers do
MARKED = re.compile(r"⧛(?:\x1b\[[\d;]*m)?(.*?)(?:\x1b\[[\d;]*m)?⧚", re.DOTALL)  # the place that formulaic points at


@dataclass(frozen=True)
class Scoped:
    """A product of factors, each with all of its columns or without the first.

    Attributes:
        scale: a number that it is multiplied by. factors: text, whether it is without its first column.
    """

    scale: float
    factors: tuple[tuple[str, bool], ...]


def scoped(terms: Iterable[Sequence[str]], texts: Iterable[str], levels: Mapping[str, int]) -> list[Scoped]:
    """Which columns of which factors are multiplied, as formulaic decides it from their kinds alone.

    Each factor is shown to it as a column of one row: a number, or a category, with two levels for many.

    Args:
        terms: products of texts. texts: those that are factors; what else stands in terms is a number.
        levels: of the texts that are categories.
    """
    import formulaic
    import pandas as pd
    from formulaic.parser.types import Factor, Term

    names = {text: f"f{i}" for i, text in enumerate(texts)}
    back = {name: text for text, name in names.items()}
    frame = pd.DataFrame(
        {
            name: pd.Categorical([0], categories=range(min(levels[text], 2))) if text in levels else [1.0]
            for text, name in names.items()
        },
        index=[0],
    )
    shown = [
        Term(Factor(names[text]) if text in names else Factor(text, eval_method="literal") for text in term)
        for term in terms
    ]
    spec: Any = formulaic.model_matrix(formulaic.SimpleFormula(shown, _ordering="none"), frame).model_spec
    return [
        Scoped(float(each.scale), tuple((back[one.factor.expr], bool(one.reduced)) for one in each.factors))
        for term in spec.structure
        for each in term.scoped_terms
    ]


def require_powers(formula: str) -> None:
    """Refuse powers of one term, which are that term, and such as would take for ever to write out."""
    from formulaic.parser import DefaultFormulaParser

    tokens = list(DefaultFormulaParser().get_tokens(formula))
    for base, (before, token) in zip(tokens, pairwise(tokens[1:]), strict=False):
        if before.token not in ("**", "^") or not token.token.isdecimal():
            continue
        if base.token != ")":
            text = f"{base.token}**{token.token}"
            raise UserError(
                f"{text}, at character {(base.source_start or 0) + 1}, is a power of a term, which is {base.token} "
                f"itself; the power of a number is {{{text}}} or I({text})"
            )
        if int(token.token) > POWER:
            raise UserError(
                f"a power {token.token} of terms, at character {token.source_start + 1}, at most {POWER} is written "
                "out; the power of a number stands in braces: {s**8}"
            )


def require_few(formula: str, largest: int, every: int = 1) -> None:
    """Refuse a formula that would be more terms than so many, before they are written out: a*b*c* … doubles each time.

    Args:
        every: terms that `.` stands for.
    """
    from formulaic.parser import DefaultFormulaParser
    from formulaic.parser.types import ASTNode

    tree = DefaultFormulaParser().get_ast(formula)
    order, open_ = list[Any](), [tree]
    while open_:  # parents stand before their children; sums of a thousand terms are deeper than Python recurses
        order.append(node := open_.pop())
        open_ += node.args if isinstance(node, ASTNode) else ()
    counts = dict[int, int]()
    for node in reversed(order):
        if not isinstance(node, ASTNode):
            counts[id(node)] = 1
            continue
        sizes = [counts[id(each)] for each in node.args]
        match node.operator.symbol, sizes:
            case ".", _:
                count = every
            case ":", [one, two]:
                count = one * two
            case "*", [one, two]:
                count = one + two + one * two
            case (("**" | "^"), [one, _]):
                power = str(node.args[1])
                count = one ** int(power) if power.isdecimal() else one
            case _:
                count = sum(sizes)
        counts[id(node)] = count = min(count, largest + 1)
        if count > largest:
            raise UserError(f"more than {largest} terms; write those that matter, a:b for a product of two")


def complaint(error: Exception) -> str:
    """What formulaic says of a text that is no formula, and where."""
    message, *_ = str(error).strip().splitlines() or [type(error).__name__]
    message = message.rstrip(".")
    if (mark := MARKED.search(str(error))) is None:
        return message.partition(". ")[0]
    before = str(error)[: mark.start()].rpartition("\n\n")[2]
    return f"{message} (at character {len(before) + 1}: {mark[1]!r})"

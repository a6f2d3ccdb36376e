"""The terms of a formula, in the grammar of R, as blocks of columns that torch computes.

The package `formulaic` reads the text and says which categories lose their first column, so that no column is a sum of
others (what R and patsy do). It is shown no data: factors are compiled here, and levels are the problem's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from typing import Any

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.core.steps import Steps
from credit.recovery.features.coordinates import Coordinate, Coordinates
from credit.recovery.features.expressions import ALLOWED, Expression

LARGEST = 10_000  # columns
POWER = 5  # largest power of terms: (s + a)**5; what is written out grows with it as powers do
MARKED = re.compile(r"⧛(?:\x1b\[[\d;]*m)?(.*?)(?:\x1b\[[\d;]*m)?⧚", re.DOTALL)  # the place that formulaic points at

Part = Callable[[Steps], Tensor]  # steps → [..., k]


@dataclass(frozen=True)
class Block:
    """The columns of one product of factors.

    Attributes:
        name: as the formula has it. scale: a number that it is multiplied by. parts: its factors. size: columns.
        coordinates: what it looks at.
    """

    name: str
    scale: float
    parts: tuple[Part, ...]
    size: int
    coordinates: tuple[Coordinate, ...]

    def __call__(self, steps: Steps) -> Tensor:
        """[..., k] float64: the categories of the first factor change fastest."""
        shape = steps.actions.shape if not steps.actions.is_floating_point() else steps.actions.shape[:-1]
        columns = torch.full((*shape, 1), self.scale, dtype=FLOAT, device=steps.actions.device)
        for part in self.parts:
            columns = (part(steps).unsqueeze(-1) * columns.unsqueeze(-2)).flatten(-2)
        return columns


@dataclass(frozen=True)
class Parsed:
    """A formula that was read: terms, products of expressions and numbers.

    Attributes:
        formula: the text. terms: of each the texts of its factors. expressions: text → what it says; else numbers.
    """

    formula: str
    terms: tuple[tuple[str, ...], ...]
    expressions: dict[str, Expression]

    @classmethod
    def of(cls, formula: str) -> Parsed:
        """Read a formula.

        Raises:
            UserError: `formulaic` is not installed; the text is no formula, or reaches for something else.
        """
        try:
            import formulaic
        except ImportError:
            raise UserError(
                f"features.formula={formula!r}: formulas are read by a package: pip install 'credit-rl[formula]'"
            ) from None
        found, said = None, "there is nothing in it"
        if formula.strip():
            try:
                _require_powers(formula)
                found = formulaic.Formula(formula)
                said = "there is no term in it" if found == [] else "~ and | make several formulas, and one is wanted"
            except UserError as error:
                said = str(error)
            except Exception as error:  # of any kind, where the text is no formula
                said = _said(error)
        if not isinstance(found, formulaic.SimpleFormula) or not found:
            raise UserError(f"features.formula={formula!r}: {said}; write terms like 1 + s + a + s:a ({ALLOWED})")
        expressions: dict[str, Expression] = {}
        for factor in (factor for term in found for factor in term.factors):
            if factor.eval_method.value == "literal":
                continue
            try:
                if factor.eval_method.value == "lookup" and not factor.expr.isidentifier():
                    raise UserError(f"{factor.expr!r} is no name of a coordinate; {ALLOWED}")
                expressions[factor.expr] = Expression.of(factor.expr)
            except UserError as error:
                raise UserError(f"features.formula={formula!r}: {error}") from None
        terms = tuple(tuple(factor.expr for factor in term.factors) for term in found)
        return cls(formula, terms, expressions)

    def blocks(self, known: Coordinates) -> list[Block]:
        """Its columns, where coordinates are these.

        Raises:
            UserError: a coordinate is not there, or no category; too many columns.
        """
        found, levels = dict[str, Coordinate](), dict[str, int]()
        for text, expression in self.expressions.items():
            try:
                found |= {name: known.find(name) for name in expression.names}
                if expression.category:
                    levels[text] = _levels(text, found[expression.names[0]])
            except UserError as error:
                raise UserError(f"features.formula={self.formula!r}: {error}") from None
        columns = sum(prod(levels.get(text, 1) for text in term) for term in self.terms)
        if columns > LARGEST:
            raise UserError(
                f"features.formula={self.formula!r}: {columns} columns, at most {LARGEST} are made; a table "
                "of that size is reward=ridge_table"
            )
        parts = {text: self._part(text, found, levels.get(text)) for text in self.expressions}
        return [self._block(scoped, parts, found, levels) for scoped in _scoped(self.terms, self.expressions, levels)]

    def _part(self, text: str, found: dict[str, Coordinate], levels: int | None) -> Callable[[int], Part]:
        """What a factor is, less its first so many columns."""
        values = self.expressions[text].values(found)
        if levels is None:
            return lambda first: lambda steps: values(steps).unsqueeze(-1)

        def indicators(first: int) -> Part:
            def part(steps: Steps) -> Tensor:
                level = torch.arange(first, levels, device=steps.states.device)
                return (values(steps).unsqueeze(-1) == level).to(FLOAT)

            return part

        return indicators

    def _block(
        self,
        scoped: _Scoped,
        parts: dict[str, Callable[[int], Part]],
        found: dict[str, Coordinate],
        levels: dict[str, int],
    ) -> Block:
        size = prod(levels.get(text, 1) - reduced for text, reduced in scoped.factors)
        names = dict.fromkeys(name for text, _ in scoped.factors for name in self.expressions[text].names)
        return Block(
            ":".join(text for text, _ in scoped.factors) or "1",
            scoped.scale,
            tuple(parts[text](int(reduced)) for text, reduced in scoped.factors),
            size,
            tuple(found[name] for name in names),
        )


@dataclass(frozen=True)
class _Scoped:
    """A product of factors, each with all of its columns or without the first."""

    scale: float
    factors: tuple[tuple[str, bool], ...]


def _scoped(
    terms: Iterable[Sequence[str]], expressions: dict[str, Expression], levels: dict[str, int]
) -> list[_Scoped]:
    """Which columns of which factors are multiplied, as formulaic decides it from their kinds alone.

    Each factor is shown to it as a column of one row: a number, or a category with its levels.
    """
    import formulaic
    import pandas as pd
    from formulaic.parser.types import Factor, Term

    names = {text: f"f{i}" for i, text in enumerate(expressions)}
    texts = {name: text for text, name in names.items()}
    frame = pd.DataFrame(
        {
            name: pd.Categorical([0], categories=range(levels[text])) if text in levels else [1.0]
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
        _Scoped(float(scoped.scale), tuple((texts[each.factor.expr], bool(each.reduced)) for each in scoped.factors))
        for term in spec.structure
        for scoped in term.scoped_terms
    ]


def _levels(text: str, coordinate: Coordinate) -> int:
    if coordinate.levels is None:
        raise UserError(
            f"{text}: {coordinate.name} is a real number here, and categories are of whole ones; use features=cells "
            "for a coordinate cut into cells"
        )
    return coordinate.levels


def _require_powers(formula: str) -> None:
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


def _said(error: Exception) -> str:
    """What formulaic says, and where."""
    message, *_ = str(error).strip().splitlines() or [type(error).__name__]
    message = message.rstrip(".")
    if (mark := MARKED.search(str(error))) is None:
        return message.partition(". ")[0]
    before = str(error)[: mark.start()].rpartition("\n\n")[2]
    return f"{message} (at character {len(before) + 1}: {mark[1]!r})"

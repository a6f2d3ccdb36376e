"""The terms of a formula, in the grammar of R, as blocks of columns that torch computes.

The package `formulaic` reads the text and says which categories lose their first column, so that no column is a sum of
others (what R and patsy do). It is shown no data: factors are compiled here, and levels are the problem's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.core.steps import Steps
from credit.recovery.features.coordinates import Coordinate, Coordinates
from credit.recovery.features.expressions import ALLOWED, Expression
from credit.recovery.features.grammar import Scoped, complaint, require_few, require_powers, scoped

LARGEST = 10_000  # columns

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
                require_powers(formula)
                require_few(formula, LARGEST)
                found = formulaic.Formula(formula)
                said = "there is no term in it" if found == [] else "~ and | make several formulas, and one is wanted"
            except UserError as error:
                said = str(error)
            except Exception as error:  # of any kind, where the text is no formula
                said = complaint(error)
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
        return [self._block(each, parts, found, levels) for each in scoped(self.terms, self.expressions, levels)]

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
        scoped: Scoped,
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


def _levels(text: str, coordinate: Coordinate) -> int:
    if coordinate.levels is None:
        raise UserError(
            f"{text}: {coordinate.name} is a real number here, and categories are of whole ones; use features=cells "
            "for a coordinate cut into cells"
        )
    return coordinate.levels

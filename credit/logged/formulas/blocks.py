"""Products of factors as columns of a design."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas import bases
from credit.logged.formulas.compute import Rows
from credit.logged.formulas.reading import levels
from credit.logged.formulas.safety import BASES, called, column, features
from credit.logged.panel import INTERCEPT, Column, Floats


@dataclass(frozen=True)
class Factor:
    """One factor, with numbers in the places of all parameters.

    Attributes:
        tree: what it is. levels: of a category. reduced: whether it is without its first column.
    """

    tree: ast.expr
    levels: tuple[Any, ...] | None
    reduced: bool

    @classmethod
    def of(cls, tree: ast.expr, reduced: bool, columns: Mapping[str, Column]) -> Factor:
        """A factor of these columns."""
        return cls(tree, levels(tree, columns), reduced)

    @cached_property
    def text(self) -> str:
        """As a formula has it."""
        return self.tree.id.strip("`") if isinstance(self.tree, ast.Name) else ast.unparse(self.tree)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of its columns, as formulaic has them."""
        if self.levels is not None:
            mark = "T." if self.reduced else ""
            return tuple(f"{self.text}[{mark}{level}]" for level in self.levels[int(self.reduced) :])
        if called(self.tree) in BASES:
            return tuple(f"{self.text}[{at + 1}]" for at in range(int(self.reduced), bases.size(self.tree)))
        return (self.text,)

    def fill(self, rows: Rows, values: Floats) -> None:
        """Its columns [n, k].

        Raises:
            UserError: a row in which it is no number.
        """
        if self.levels is not None:
            name = self.tree.args[0] if isinstance(self.tree, ast.Call) else self.tree
            assert isinstance(name, ast.Name)
            codes = rows.codes(column(name), self.levels)
            for at in range(values.shape[1]):
                np.equal(codes, at + self.reduced, out=values[:, at], casting="unsafe")
        elif called(self.tree) in BASES:
            assert isinstance(self.tree, ast.Call)
            inner = np.broadcast_to(rows.values(self.tree.args[0]), (len(values),))
            self._require_finite(inner, rows, self.tree.args[0])
            if not self.reduced:
                bases.fill(rows.learned[self.text], inner, values)
                return
            whole = np.empty((len(values), bases.size(self.tree)), order="F")
            bases.fill(rows.learned[self.text], inner, whole)
            values[:] = whole[:, 1:]
        else:
            values[:, 0] = rows.values(self.tree)
            if not isinstance(self.tree, ast.Name):
                self._require_finite(values[:, 0], rows, self.tree)

    def _require_finite(self, values: Floats, rows: Rows, tree: ast.expr) -> None:
        if np.isfinite(values.sum()) or np.isfinite(values).all():
            return
        row = int(np.argmin(np.isfinite(values)))
        given = [f"{name} is {rows.feature(name)[row]:g}" for name in features(tree)]
        raise UserError(
            f"{ast.unparse(tree)} is {values[row]:g} in {rows.place(row)}"
            f"{', where ' if given else ''}{' and '.join(given)}; a formula is to be a finite number in every row: "
            "log1p(x) for log(x) where x is 0"
        )


@dataclass(frozen=True)
class Block:
    """The columns of one product of factors, those of the first factor changing fastest.

    Attributes:
        scale: a number that it is multiplied by. factors: of it; none is an intercept.
    """

    scale: float
    factors: tuple[Factor, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of its columns."""
        if not self.factors:
            return (INTERCEPT,)
        return tuple(":".join(reversed(each)) for each in product(*(one.names for one in reversed(self.factors))))

    @cached_property
    def features(self) -> tuple[str, ...]:
        """What stands in it."""
        return tuple(dict.fromkeys(name for one in self.factors for name in features(one.tree)))

    @property
    def size(self) -> int:
        """How many columns it has."""
        return prod(len(one.names) for one in self.factors)

    @np.errstate(all="ignore")  # what is no number is said, with its row
    def fill(self, rows: Rows, values: Floats) -> None:
        """Its columns [n, k].

        Raises:
            UserError: a row in which it is no number.
        """
        if not self.factors:
            values[:] = self.scale
            return
        if len(self.factors) == 1:
            self.factors[0].fill(rows, values)
        else:
            parts = [np.empty((len(values), len(one.names)), order="F") for one in self.factors]
            for one, part in zip(self.factors, parts, strict=True):
                one.fill(rows, part)
            for at, each in enumerate(product(*(range(part.shape[1]) for part in reversed(parts)))):
                place, *others = each[::-1]
                np.copyto(values[:, at], parts[0][:, place])
                for part, other in zip(parts[1:], others, strict=True):
                    values[:, at] *= part[:, other]
        if self.scale != 1:
            values *= self.scale

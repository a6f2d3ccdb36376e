"""Factors of a formula over the quantiles of a column, which stand for all rows where the rows are not at hand."""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from credit.logged.formulas.compute import Source
from credit.logged.formulas.safety import LEARNED, called, numbers
from credit.logged.panel import Column, Floats

POINTS = 2001  # of a quantile function, straight from one of a column's quantiles to the next


class Quantiles(Source):
    """What all rows of a column say of its values, in ascending order, for functions of one column.

    Where carry-over is asked for, x/(1 − decay) stands for it: what it comes to when x goes on.
    """

    def __init__(self, columns: Mapping[str, Column], exact: bool) -> None:
        super().__init__({})
        self._columns, self._exact = columns, exact

    def feature(self, name: str) -> Floats:
        """Quantiles, 21 exact ones or many between them."""
        one = self._columns[name]
        points = np.asarray(one.quantiles or np.linspace(one.least, one.most, 21), np.float64)
        grid = np.linspace(0, 1, POINTS)
        return points if self._exact else np.interp(grid, np.linspace(0, 1, len(points)), points)

    def carried(self, tree: ast.Call, inner: Floats) -> Floats:
        """What it comes to in the long run."""
        return inner if called(tree) == "lag" else inner / (1 - numbers(tree)[0])

    def place(self, row: int) -> str:
        """A quantile has no row."""
        return "some row"

    def values(self, tree: ast.expr) -> Floats:
        """As of every source; what is to be learned is learned here."""
        if called(tree) not in LEARNED or ast.unparse(tree) in self.learned:
            return super().values(tree)
        assert isinstance(tree, ast.Call)
        inner = self.values(tree.args[0])
        return (inner - np.mean(inner)) / (np.std(inner) or 1.0 if called(tree) != "center" else 1.0)

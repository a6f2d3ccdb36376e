"""The numbers of a factor: a tree that `safety` has read is walked over rows; what it knows is a `Source`."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError, nearest
from credit.logged.formulas import carry
from credit.logged.formulas.safety import CARRIED, LEARNED, called, column, features, numbers
from credit.logged.panel import Column, Floats, Part

FUNCTIONS: dict[str, Callable[[Floats], Floats]] = {
    "I": lambda values: values,
    "log": np.log,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sin": np.sin,
    "cos": np.cos,
    "tanh": np.tanh,
    "log1p": np.log1p,
}
OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
Learned = dict[str, Any]  # of a call: what is fixed, in plain numbers


class Source(ABC):
    """What stands behind the names of features."""

    def __init__(self, learned: Mapping[str, Learned]) -> None:
        self.learned = learned

    @abstractmethod
    def feature(self, name: str) -> Floats:
        """Its values [n]."""

    @abstractmethod
    def carried(self, tree: ast.Call, inner: Floats) -> Floats:
        """A lag or adstock [n] of values [n]."""

    @abstractmethod
    def place(self, row: int) -> str:
        """What a row is called, for messages."""

    def values(self, tree: ast.expr) -> Floats:
        """What a number of a formula is in every row [n], or a number where it holds no feature.

        Raises:
            UserError: saturate of what is negative.
        """
        match tree:
            case ast.Name():
                return self.feature(column(tree))
            case ast.Constant(value=value):
                return np.float64(value)  # type: ignore[return-value, arg-type]
            case ast.BinOp(left=left, op=op, right=right):
                return OPERATORS[type(op)](self.values(left), self.values(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.values(operand)
            case ast.UnaryOp(operand=operand):
                return self.values(operand)
            case ast.Call():
                return self._called(tree)
        raise AssertionError(f"{ast.dump(tree)} was not checked")

    def _called(self, tree: ast.Call) -> Floats:
        name, inner = called(tree), self.values(tree.args[0])
        if name in FUNCTIONS:
            assert name is not None
            return FUNCTIONS[name](inner)
        if name in CARRIED:
            return self.carried(tree, inner)
        if name in LEARNED:
            known = self.learned[ast.unparse(tree)]
            return (inner - known["center"]) / known["scale"]
        half = numbers(tree)[0]
        if np.size(inner) and np.min(inner) < 0:
            all_ = np.atleast_1d(inner)
            row, text = int(np.argmax(all_ < 0)), ast.unparse(tree.args[0])
            raise UserError(
                f"{ast.unparse(tree)}: {text} is {all_[row]:g} in {self.place(row)}, "
                "and saturate(x, half) = x/(x + half) is for what is not negative; abs(x), or another term"
            )
        return inner / (inner + half)


class Rows(Source):
    """Rows of a part.

    Args:
        part: of them. columns: features by name. learned: text of a call → what is fixed.
        state: what the part before left; it is changed to what this one leaves. replaced: feature → its value in all.
    """

    def __init__(
        self,
        part: Part,
        columns: Mapping[str, Column],
        learned: Mapping[str, Learned],
        state: dict[str, Floats],
        replaced: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(learned)
        self.part, self._columns, self._state, self._replaced = part, columns, state, replaced or {}
        self._seen: dict[str, Floats] = {}

    def feature(self, name: str) -> Floats:
        """Its values [n]."""
        if name in self._replaced:
            return np.full(len(self.part), float(self._replaced[name]))
        return np.asarray(self._series(name), dtype=np.float64)

    def carried(self, tree: ast.Call, inner: Floats) -> Floats:
        """A lag or adstock [n], computed once for all terms that have it."""
        text = ast.unparse(tree)
        if text not in self._seen:
            before = self._state.get(text, carry.NOTHING) if self.part.continues else carry.NOTHING
            x, number = np.broadcast_to(np.asarray(inner, np.float64), (len(self.part),)), numbers(tree)[0]
            if called(tree) == "lag":
                names = features(tree)
                stock = bool(names) and all(self._columns[each].stock for each in names)
                values, left = carry.lag(np.ascontiguousarray(x), int(number), self.part.group, before, stock)
            else:
                values, left = carry.adstock(np.ascontiguousarray(x), number, self.part.group, before)
            self._seen[text], self._state[text] = values, left
        return self._seen[text]

    def values(self, tree: ast.expr) -> Floats:
        """As of every source, without carrying a part on twice."""
        if called(tree) in CARRIED and (text := ast.unparse(tree)) in self._seen:
            return self._seen[text]
        return super().values(tree)

    def place(self, row: int) -> str:
        """The number of a row in what was given."""
        return f"row {self.part.frame.index[row]}"

    def codes(self, name: str, levels: tuple[Any, ...]) -> NDArray[np.integer[Any]]:
        """Which level a category has [n]; of a number, which whole one it is.

        Raises:
            UserError: one that is not among them.
        """
        import pandas as pd

        if self._columns[name].levels is None:
            values = self.feature(name)
            numbered = np.where((values >= levels[0]) & (values <= levels[-1]), values - levels[0], -1).astype(np.int64)
            return self._known(name, np.where(numbered + levels[0] == values, numbered, -1), levels)
        if name in self._replaced:
            return np.full(len(self.part), code(name, self._replaced[name], levels), dtype=np.int64)
        series = self._series(name)
        if not isinstance(series.dtype, pd.CategoricalDtype):
            series = series.astype("category")
        own = tuple(series.cat.categories)
        codes = series.cat.codes.to_numpy()
        if own != levels:
            by_text = {str(level): at for at, level in enumerate(levels)}
            place = {level: at for at, level in enumerate(levels)}
            codes = np.array([*(place.get(level, by_text.get(str(level), -1)) for level in own), -1])[codes]
        return self._known(name, codes, levels)

    def _known(self, name: str, codes: NDArray[np.integer[Any]], levels: tuple[Any, ...]) -> NDArray[np.integer[Any]]:
        if len(codes) and codes.min() < 0:
            row = int(np.argmax(codes < 0))
            value = self._replaced[name] if name in self._replaced else self._series(name).iloc[row]
            value = value.item() if isinstance(value, np.generic) else value
            raise UserError(
                f"{name} is {value!r} in {self.place(row)}, which is none of its values; "
                f"{nearest(str(value), map(str, levels))}"
            )
        return codes

    def _series(self, name: str) -> Any:
        if name not in self.part.frame.columns:
            raise UserError(f"there is no column {name!r}; {nearest(name, map(str, self.part.frame.columns))}")
        return self.part.frame[name]


def code(name: str, value: Any, levels: tuple[Any, ...]) -> int:
    """Which level a value is; a text is the level that is written like it."""
    for same in (lambda level: level == value, lambda level: str(level) == str(value)):
        if found := [code for code, level in enumerate(levels) if same(level)]:
            return found[0]
    raise UserError(f"{value!r} is no value of {name}; {nearest(str(value), map(str, levels))}")

"""Arithmetic on coordinates: text → torch, and nothing else. No Python is run."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from credit.core.errors import UserError, nearest
from credit.core.problem import FLOAT
from credit.core.steps import Steps
from credit.recovery.features.coordinates import Coordinate

Values = Callable[[Steps], Tensor]  # steps → [...] float64

FUNCTIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "log": torch.log,
    "exp": torch.exp,
    "sqrt": torch.sqrt,
    "abs": torch.abs,
    "sin": torch.sin,
    "cos": torch.cos,
    "tanh": torch.tanh,
    "I": lambda values: values,
}
OPERATORS: dict[type[ast.operator], Callable[[Tensor, Tensor], Tensor]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
SIGNS: dict[type[ast.unaryop], Callable[[Tensor], Tensor]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
CATEGORY = "C"
LARGEST = 1e300  # number
ALLOWED = (
    f"allowed: coordinates, numbers, + - * / ** and the functions {', '.join(FUNCTIONS)}; and {CATEGORY}(coordinate) "
    "as a factor of its own"
)


@dataclass(frozen=True)
class Expression:
    """One factor of a formula.

    Attributes:
        text: as it is written. names: the coordinates in it. category: whether it is C(coordinate).
    """

    text: str
    names: tuple[str, ...]
    category: bool
    _tree: ast.expr

    @classmethod
    def of(cls, text: str) -> Expression:
        """Read a text.

        Raises:
            UserError: it is no arithmetic, with the word that is not allowed.
        """
        try:
            tree = ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise UserError(f"{text!r} cannot be read; {ALLOWED}") from None
        called = tree.func if isinstance(tree, ast.Call) else None
        category = isinstance(called, ast.Name) and called.id == CATEGORY
        if category:
            assert isinstance(tree, ast.Call)
            if len(tree.args) != 1 or tree.keywords or not isinstance(tree.args[0], ast.Name):
                raise UserError(f"{text!r}: {CATEGORY} takes one coordinate and nothing else, like C(a)")
            tree = tree.args[0]
        names: dict[str, None] = {}
        _check(tree, names)
        return cls(text, tuple(names), category, tree)

    def values(self, coordinates: Mapping[str, Coordinate]) -> Values:
        """The function of steps that it is, where its names mean coordinates."""
        return _compiled(self._tree, coordinates)


def _check(node: ast.expr, names: dict[str, None]) -> None:
    """Collect names; refuse what is no arithmetic."""
    match node:
        case ast.Name(id=name):
            names[name] = None
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and value < LARGEST:
            pass
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            _check(left, names)
            _check(right, names)
        case ast.UnaryOp(op=sign, operand=operand) if type(sign) in SIGNS:
            _check(operand, names)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            _check(argument, names)
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
            raise UserError(f"{ast.unparse(node)!r}: {name} takes one argument; {ALLOWED}")
        case ast.Call(func=ast.Name(id=name)) if name == CATEGORY:
            raise UserError(f"{ast.unparse(node)!r}: categories are no numbers; {ALLOWED}")
        case ast.Call(func=ast.Name(id=name)):
            close = nearest(name, FUNCTIONS).partition(" (")[0]
            hint = f"; {close}" if close.startswith("did") else ""
            raise UserError(f"{name!r} is no function that may be used{hint} ({ALLOWED})")
        case _:
            raise UserError(f"{ast.unparse(node)!r} is no arithmetic; {ALLOWED}")


def _compiled(node: ast.expr, coordinates: Mapping[str, Coordinate]) -> Values:
    """A function of steps."""
    match node:
        case ast.Name(id=name):
            return coordinates[name]
        case ast.Constant(value=value):
            number = torch.tensor(float(value), dtype=FLOAT)  # type: ignore[arg-type]
            return lambda steps: number.to(steps.states.device)
        case ast.BinOp(left=left, op=op, right=right):
            combine, one, two = OPERATORS[type(op)], _compiled(left, coordinates), _compiled(right, coordinates)
            return lambda steps: combine(one(steps), two(steps))
        case ast.UnaryOp(op=sign, operand=operand):
            turn, inner = SIGNS[type(sign)], _compiled(operand, coordinates)
            return lambda steps: turn(inner(steps))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            function, inner = FUNCTIONS[name], _compiled(argument, coordinates)
            return lambda steps: function(inner(steps))
    raise AssertionError(f"{ast.dump(node)} was not checked")

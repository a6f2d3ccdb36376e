"""A factor of a formula: text → a tree of nothing but features, numbers, arithmetic and calls that are listed here.

Trees are Python's, so that they can be printed, but none is ever run: `compute` walks them. Calls are brought into one
form, adstock(x, decay=.5) → adstock(x, 0.5), and names that are no identifiers keep their backticks.
"""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from credit.core.errors import UserError, nearest

ELEMENTWISE = ("I", "log", "exp", "sqrt", "abs", "sin", "cos", "tanh", "log1p")
CARRIED = ("lag", "adstock")  # look at rows before
LEARNED = ("center", "scale", "standardize")  # look at the mean and deviation of all rows
BASES = ("bs", "cr", "cs", "poly")  # several columns
CATEGORY = "C"
OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
SIGNS = (ast.UAdd, ast.USub)
LARGEST, DEEPEST = 1e300, 60  # number, calls in each other


@dataclass(frozen=True)
class Parameter:
    """A number that a call takes beside what it is a function of.

    Attributes:
        name: of it. allowed: what it may be, in words. holds: whether a number is. default: where it is left out.
        free: left out, or a list, it is chosen by cross-validation. needed: it may not be left out.
    """

    name: str
    allowed: str
    holds: Callable[[float], bool]
    default: float | None = None
    free: bool = False
    needed: bool = False


def _whole(name: str, least: int, most: int, default: int | None = None, free: bool = False) -> Parameter:
    allowed = f"a whole number from {least} to {most}"
    return Parameter(name, allowed, lambda value: least <= value <= most and value == int(value), default, free)


PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    **dict.fromkeys((*ELEMENTWISE, *LEARNED, CATEGORY), ()),
    "lag": (_whole("k", 0, 10_000, free=True),),
    "adstock": (Parameter("decay", "from 0 to less than 1", lambda value: 0 <= value < 1, free=True),),
    "saturate": (Parameter("half", "above 0", lambda value: value > 0, free=True),),
    "bs": (_whole("df", 1, 100, 3), _whole("degree", 1, 5, 3)),
    **dict.fromkeys(("cr", "cs"), (replace(_whole("df", 3, 100), needed=True),)),
    "poly": (_whole("degree", 1, 10, 1),),
}
SIGNATURES = {name: f"{name}({', '.join(['x', *(one.name for one in taken)])})" for name, taken in PARAMETERS.items()}
ALLOWED = f"allowed: features, numbers, + - * / ** inside {{}} or I(), and {', '.join(SIGNATURES.values())}"


def column(name: ast.Name) -> str:
    """The feature that a name in a tree means."""
    return name.id.strip("`")


def features(tree: ast.expr) -> tuple[str, ...]:
    """Those in a tree, each once, in order."""
    arguments = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node not in arguments]
    return tuple(dict.fromkeys(map(column, names)))


def numbers(tree: ast.expr) -> tuple[float, ...]:
    """The parameters of a call, of which none is free."""
    assert isinstance(tree, ast.Call)
    given = [_value(node) for node in tree.args[1:]]
    left_out = [one.default for one in PARAMETERS[called(tree) or ""][len(given) :]]
    assert None not in left_out
    return (*given, *(value for value in left_out if value is not None))


def named(name: str) -> ast.Name:
    """A feature in a tree."""
    return ast.Name(name if name.isidentifier() and not keyword.iskeyword(name) else f"`{name}`")


def called(tree: ast.expr) -> str | None:
    """The function whose call a tree is; None for what is no call."""
    return tree.func.id if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) else None


def read(text: str, at: int, known: Callable[[str, int], bool]) -> ast.expr:
    """The tree of a factor.

    Args:
        text: of it. at: characters of the formula before it. known: whether a feature (name, character) is a category;
            it raises what is to be said of one that is not there.

    Raises:
        UserError: anything that is not listed, with its place in the formula.
    """
    shown = _Shown(text, at, known)
    try:
        tree = ast.parse(shown.code, mode="eval").body
    except SyntaxError as error:
        place = at + min(max(error.offset or 1, 1), len(text) or 1)
        raise UserError(f"{text!r} cannot be read, at character {place} ({error.msg}); {ALLOWED}") from None
    except (ValueError, RecursionError, MemoryError):
        raise UserError(f"{text!r}, at character {at + 1}, cannot be read; {ALLOWED}") from None
    return shown.outer(tree)


class _Shown:
    """The text, with names in backticks as identifiers of the same length, so that places stay what they are."""

    def __init__(self, text: str, at: int, known: Callable[[str, int], bool]) -> None:
        self._text, self._at, self._known = text, at, known
        self._quoted: dict[str, str] = {}
        self.code = re.sub("`[^`]+`", self._quote, text.replace("\n", " ").replace("\r", " ").replace("\t", " "))
        lead = len(self.code) - len(self.code.lstrip())
        self.code, self._text, self._at = self.code[lead:], self._text[lead:], at + lead

    def _quote(self, found: re.Match[str]) -> str:
        name = f"ʘ{len(self._quoted):0{len(found[0]) - 1}d}"  # no feature begins with a click of the lips
        self._quoted[name] = found[0][1:-1]
        return name

    def outer(self, tree: ast.expr) -> ast.expr:
        """A factor as a whole: a category, a basis, or a number."""
        name = called(tree)
        if name == CATEGORY or (isinstance(tree, ast.Name) and self._is_category(tree)):
            inner = self._arguments(tree, CATEGORY)[0] if isinstance(tree, ast.Call) else tree
            if not isinstance(inner, ast.Name):
                raise self._refused(inner or tree, f"is no feature, and {CATEGORY} takes one, like C(region)")
            self._is_category(inner)
            feature = named(self._name(inner))
            return ast.Call(ast.Name(CATEGORY), [feature], []) if name else feature
        if name in BASES:
            assert isinstance(tree, ast.Call)
            return self._call(tree, name, 0)
        return self._number(tree, 0)

    def _number(self, node: ast.expr, depth: int) -> ast.expr:
        if depth > DEEPEST:
            raise self._refused(node, "is too deep")
        match node:
            case ast.Name():
                if self._is_category(node):
                    raise self._refused(node, "is a category, and no number; categories stand by themselves")
                return named(self._name(node))
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and value < LARGEST:
                return ast.Constant(value)
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, OPERATORS):
                return ast.BinOp(self._number(left, depth + 1), op, self._number(right, depth + 1))
            case ast.UnaryOp(op=sign, operand=operand) if isinstance(sign, SIGNS):
                return ast.UnaryOp(sign, self._number(operand, depth + 1))
            case ast.Call(func=ast.Name(id=name)) if name in (*BASES, CATEGORY):
                raise self._refused(node, f"is several columns, and no number; {name} stands by itself")
            case ast.Call(func=ast.Name(id=name)) if name in PARAMETERS:
                return self._call(node, name, depth)
            case ast.Call(func=ast.Name(id=name) as function):
                close = nearest(name, PARAMETERS).partition(" (")[0]
                hint = f"; {close}" if close.startswith("did") else ""
                raise self._refused(function, f"is no function that may be used{hint}")
        raise self._refused(node, "is no arithmetic")

    def _call(self, node: ast.Call, name: str, depth: int) -> ast.Call:
        """A call with its parameters in order, less defaults at the end; free ones are left out, or a list."""
        inner, *given = self._arguments(node, name)
        assert inner is not None
        taken = [self._parameter(value, one) for value, one in zip(given, PARAMETERS[name], strict=True)]
        if name == "bs":
            df, degree = (taken[1] if given[0] is None else taken[0]), taken[1]
            if _value(df) < _value(degree):
                raise self._refused(node, f"has fewer columns than its degree: df is at least {_value(degree)}")
            taken = [df, degree]
        while (
            taken and taken[-1] is not None and ast.unparse(taken[-1]) == str(PARAMETERS[name][len(taken) - 1].default)
        ):
            taken.pop()
        return ast.Call(ast.Name(name), [self._number(inner, depth + 1), *filter(None, taken)], [])

    def _arguments(self, node: ast.Call, name: str) -> list[ast.expr | None]:
        names = ["x", *(one.name for one in PARAMETERS[name])]
        found = dict(zip(names, node.args, strict=False))
        for given in node.keywords:
            if given.arg not in names[1:] or given.arg in found:
                raise self._refused(given.value, f"is given as {given.arg}, and {SIGNATURES[name]} is what there is")
            found[given.arg] = given.value
        if len(node.args) > len(names) or "x" not in found or any(isinstance(one, ast.Starred) for one in node.args):
            raise self._refused(node, f"is to be {SIGNATURES[name]}")
        if missing := [one.name for one in PARAMETERS[name] if one.needed and one.name not in found]:
            raise self._refused(node, f"needs {missing[0]}: {SIGNATURES[name]}")
        return [found.get(each) for each in names]

    def _parameter(self, value: ast.expr | None, one: Parameter) -> ast.expr | None:
        if value is None:
            return None if one.default is None else ast.Constant(one.default)
        if isinstance(value, ast.List) and one.free and value.elts:
            choices = [self._parameter(each, one) for each in value.elts if not isinstance(each, ast.List)]
            if len(choices) == len(value.elts):
                texts = dict.fromkeys(ast.unparse(each) for each in choices if each is not None)
                constants: list[ast.expr] = [ast.Constant(ast.literal_eval(text)) for text in texts]
                return ast.List(constants) if len(constants) > 1 else constants[0]
        match value:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool) and one.holds(number):
                return ast.Constant(number)
        several = "; or several, [.2, .5]; left out, it is chosen by cross-validation" if one.free else ""
        raise self._refused(value, f"is no {one.name}, which is {one.allowed}{several}")

    def _name(self, node: ast.Name) -> str:
        return self._quoted.get(node.id, node.id)

    def _is_category(self, node: ast.Name) -> bool:
        return self._known(self._name(node), self._at + self._place(node)[0] + 1)

    def _place(self, node: ast.expr) -> tuple[int, int]:
        """Characters before it and up to its end; Python counts bytes."""
        code, end = self.code.encode(), node.end_col_offset or 0
        return len(code[: node.col_offset].decode()), len(code[:end].decode())

    def _refused(self, node: ast.expr, why: str) -> UserError:
        first, last = self._place(node)
        return UserError(f"{self._text[first:last]!r}, at character {self._at + first + 1}, {why}; {ALLOWED}")


def _value(node: ast.expr | None) -> float:
    assert isinstance(node, ast.Constant)
    assert isinstance(node.value, int | float)
    return node.value

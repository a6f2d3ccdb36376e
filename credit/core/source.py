"""Constructor signatures as credit's own source says them: a list, or an answer to a typo, waits for no torch."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from credit.core import signatures
from credit.core.component import Component

HOME = Path(__file__).resolve().parents[1]
LIGHT = frozenset(
    {"typing", "collections.abc", "annotated_types", "math", "credit.core.ranges"}
)  # imported as they are


class Unread(LookupError):
    """The source does not tell: the class has to be imported."""


def signature(target: str) -> dict[str, tuple[Any, Any]] | None:
    """Constructor parameters of a class of credit: name → (type hint, default or REQUIRED).

    Other classes among the hints are stand-ins of the same name, and components where they are components.

    Args:
        target: its module and name, with dots.

    Returns:
        What `signatures.signature` returns; None where the class has to be imported to know.
    """
    module, _, name = target.rpartition(".")
    if module in sys.modules or module.partition(".")[0] != "credit":
        return None
    try:
        return _parameters(*_constructor(_module(module), name))
    except (LookupError, NameError, TypeError, AttributeError):
        return None


def documented(target: str) -> str | None:
    """The docstring of a class of credit, without its indentation; None where it has to be imported to know."""
    module, _, name = target.rpartition(".")
    try:
        found, there = _module(module).home(name)
        return ast.get_docstring(found.classes[there])
    except LookupError:
        return None


class _Module(dict[str, Any]):
    """What the names of a module mean, found out when they are asked for; a namespace for `eval`."""

    def __init__(self, tree: ast.Module) -> None:
        super().__init__()
        self.classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self._imports = dict(_imported(tree))
        self._values = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(target, ast.Name)
        }

    def __missing__(self, name: str) -> Any:
        if name in self.classes:
            self[name] = type(name, (Component,) if self.is_component(name) else (), {})
        elif name in self._values:
            self[name] = _evaluated(self._values[name], self)
        elif name in self._imports:
            module, there = self._imports[name]
            self[name] = getattr(importlib.import_module(module), there) if module in LIGHT else _module(module)[there]
        else:
            raise KeyError(name)  # a builtin
        return self[name]

    def home(self, name: str) -> tuple[_Module, str]:
        """The module in which a class is written, and its name there."""
        if name in self.classes:
            return self, name
        if name not in self._imports:
            raise Unread(name)
        module, there = self._imports[name]
        return _module(module).home(there)

    def is_component(self, name: str) -> bool:
        """Whether a class that is written here is a component."""
        if name == "Component":
            return True
        for base in self.classes[name].bases:
            if isinstance(base, ast.Name):
                try:
                    module, there = self.home(base.id)
                except Unread:
                    continue
                if module.is_component(there):
                    return True
        return False


@cache
def _module(name: str) -> _Module:
    path = HOME.joinpath(*name.split(".")[1:])
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if name.partition(".")[0] != "credit" or not path.is_file():
        raise Unread(name)
    return _Module(ast.parse(path.read_text(encoding="utf-8")))


def _imported(tree: ast.Module) -> Iterator[tuple[str, tuple[str, str]]]:
    """Name → module, and the name there; of what is imported for type checkers, too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((alias.asname or alias.name, (node.module, alias.name)) for alias in node.names)


def _constructor(module: _Module, name: str) -> tuple[_Module, ast.FunctionDef | None]:
    """The constructor of a class, its own or the first among its bases, and the module in which it is written."""
    module, name = module.home(name)
    node = module.classes[name]
    if name == "Component":
        return module, None
    if node.decorator_list:
        raise Unread(name)  # a dataclass has a constructor that nobody wrote
    for part in node.body:
        if isinstance(part, ast.FunctionDef) and part.name == "__init__":
            return module, part
    for base in node.bases:
        if isinstance(base, ast.Subscript):
            base = base.value
        if not isinstance(base, ast.Name):
            raise Unread(name)
        if base.id in ("Generic", "ABC", "Protocol"):
            continue
        found = _constructor(module, base.id)
        if found[1] is not None:
            return found
    return module, None


def _parameters(module: _Module, constructor: ast.FunctionDef | None) -> dict[str, tuple[Any, Any]]:
    if constructor is None:
        return {}
    given = constructor.args
    if given.vararg or given.kwarg or given.posonlyargs:
        raise Unread(constructor.name)
    names = [*given.args, *given.kwonlyargs]
    defaults = [*[None] * (len(given.args) - len(given.defaults)), *given.defaults, *given.kw_defaults]
    return {
        name.arg: (
            Any if name.annotation is None else _evaluated(name.annotation, module),
            signatures.REQUIRED if default is None else _evaluated(default, module),
        )
        for name, default in list(zip(names, defaults, strict=True))[1:]
    }


def _evaluated(node: ast.expr, module: _Module) -> Any:
    """What an expression of a module is worth: of credit's own source, and nothing else."""
    return eval(compile(ast.Expression(node), "<signature>", "eval"), {}, module)

"""Docstrings of credit, for pages: several arguments may share a line of `Args:`, `first: what. second: what.`"""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection
from typing import Any

from griffe import Class, Extension, Function

SECTION = re.compile(r"^Args:\n((?:[ \t]+\S.*\n?|\n(?=[ \t]))+)", re.M)


def arguments(docstring: str, names: Collection[str]) -> dict[str, str]:
    """Argument → what its docstring says of it; names that share a text, `a, b: what`, have it both."""
    found = SECTION.search(inspect.cleandoc(docstring) + "\n")
    if not found or not names:
        return {}
    name = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    start = re.compile(rf"(?:^|(?<=[.;,?)\]])\s|(?<=\n))\s*((?:{name})(?:, (?:{name}))*): ")
    _, *parts = start.split(inspect.cleandoc(found[1]))
    texts = zip(parts[::2], parts[1::2], strict=True)
    return {one: " ".join(text.split()) for group, text in texts for one in group.split(", ")}


class OneALine(Extension):
    """Gives mkdocstrings each argument on a line of its own, and examples their fence."""

    def on_class_members(self, *, cls: Class, **kwargs: Any) -> None:
        """A class has the arguments of its constructor."""
        maker = cls.members.get("__init__")
        rewrite(cls, maker if isinstance(maker, Function) else None)

    def on_function_instance(self, *, func: Function, **kwargs: Any) -> None:
        """A function has its own."""
        rewrite(func, func)


def rewrite(thing: Class | Function, maker: Function | None) -> None:
    """Rewrite the docstring of a class or function, whose arguments `maker` takes."""
    if thing.docstring is None:
        return
    text = inspect.cleandoc(thing.docstring.value)
    if maker and (said := arguments(text, [one.name for one in maker.parameters])):
        lines = "".join(f"    {name}: {what}\n" for name, what in said.items())
        text = SECTION.sub(lambda _: f"Args:\n{lines}\n", text + "\n")
    thing.docstring.value = re.sub(r"^Example:$", "Examples:", text, flags=re.M)

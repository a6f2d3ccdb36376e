"""What the file of an option owes its reader: a class of its kind, words, comments, and no key too many."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from credit.config import classes, files, kinds, registry, schema
from credit.core import signatures
from credit.testing.expect import expect
from credit.testing.short import selection


def selected(kind: str, name: str) -> list[str]:
    """Words that choose an option."""
    return ["tracking=none", *selection(kind, name)]


def nodes(kind: str, name: str) -> dict[str, Any]:
    """Path → configuration of the components that an option makes."""
    config = registry.compose(selected(kind, name))
    if kind in ("features", "network"):
        return {f"reference.{kind}": config["reference"][kind]}
    return schema.members(config, slot_of(kind))


def slot_of(kind: str) -> str:
    """Where options of a kind are chosen."""
    return "reference" if kind == "reward" else kind


def made_of(kind: str, name: str) -> list[type]:
    """The classes that an option makes."""
    return [classes.resolve(path, node) for path, node in nodes(kind, name).items()]


def is_described(kind: str, name: str) -> None:
    """The file says in one line what it is, and so do its classes, which are of its kind and can be made."""
    path = files.options(kind)[name]
    expect(files.describe_file(path), f"{path}: its first line must be a comment that says what it is")
    for cls in made_of(kind, name):
        base = kinds.KINDS[kind].load()
        expect(issubclass(cls, base), f"{cls.__name__} is no {base.__name__}")
        missing = ", ".join(sorted(getattr(cls, "__abstractmethods__", ())))
        expect(not inspect.isabstract(cls), f"{cls.__name__} does not define {missing}")
        said = (cls.__doc__ or "").strip()
        expect(said.splitlines()[:1], f"{cls.__name__} needs a docstring whose first line says what it is")


def is_complete(kind: str, name: str) -> None:
    """Every key of the file is a parameter, and every parameter has a value and a type hint."""
    slots = {slot for other in kinds.KINDS.values() for slot in other.slots}
    for cls, node in zip(made_of(kind, name), nodes(kind, name).values(), strict=True):
        parameters = signatures.signature(cls)
        unknown = sorted(node.keys() - {"_target_"} - parameters.keys())
        expect(not unknown, f"{cls.__name__} has no parameter {', '.join(unknown)}")
        for parameter, (hint, default) in parameters.items():
            has = parameter in node or default is not signatures.REQUIRED or parameter in slots
            expect(has, f"{cls.__name__}: its parameter {parameter} has no value, in the class or in the file")
            expect(hint is not Any, f"{cls.__name__}: its parameter {parameter} has no type hint")


def is_documented(kind: str, name: str) -> None:
    """Every parameter has words in the docstring of its class."""
    for cls in made_of(kind, name):
        for parameter in signatures.signature(cls):
            said = re.search(rf"\b{parameter}(, \w+)*:", cls.__doc__ or "")  # alone, or among others
            expect(said, f"{cls.__name__}: its docstring says nothing of {parameter} (`Args:` and `{parameter}: …`)")


def says_what_differs(kind: str, name: str) -> None:
    """A file that starts from another one has no key that is the same there."""
    node = files.read(files.options(kind)[name])
    for base in files.bases(kind, node):
        before, now = (registry.compose(selected(kind, option)) for option in (base, name))
        for key in node.keys() - {"defaults", "_target_"}:
            there, here = (next(iter(schema.members(config, slot_of(kind)).values())) for config in (before, now))
            expect(there.get(key, "…") != here[key], f"{name}.yaml: {key} is what it is in {base}.yaml; leave it out")


def is_commented(kind: str, name: str) -> None:
    """Every key of the file has a comment."""
    path = files.options(kind)[name]
    found = keys_without_comment(path)
    expect(not found, f"{path}: no comment, beside it or above, says what {', '.join(found)} is")


def keys_without_comment(path: Path) -> list[str]:
    """Keys that carry no comment, beside or above them; names and what chooses other files need none."""
    found, above, inside = [], False, False
    for line in path.read_text(encoding="utf-8").splitlines():
        stripped = line.strip()
        if stripped.startswith("#"):
            above = True
            continue
        inside = stripped == "defaults:" or (inside and stripped.startswith("-"))
        key = stripped.partition(":")[0]
        if stripped and not inside and key not in ("_target_", "name", "surrogates") and "#" not in line and not above:
            found.append(key)
        above = False
    return found


CHECKS = (is_described, is_complete, is_documented, says_what_differs, is_commented)

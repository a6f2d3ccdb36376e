"""The law of the house: who may import whom. Imports inside functions and for type checkers count, too.

core  ◄  networks, planning, data  ◄  envs · recovery · rivals · agents · judges  ◄  trainer  ◄  runs  ◄  cli
         config, on core ◄ runs, cli        tracking, report: on run folders ◄ cli        bench, testing: all
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import credit

HOUSE = Path(credit.__file__).resolve().parent
CORE = {"core"}
TOOLS = {"networks", "planning", "data"}
COMPONENTS = {"envs", "recovery", "rivals", "agents", "judges"}
LOOP = CORE | TOOLS | COMPONENTS | {"trainer"}
READERS = {"tracking", "report"}
BELOW: dict[str, set[str]] = {  # room → the rooms that it may import, beside itself
    "core": set(),
    **dict.fromkeys(TOOLS, CORE),
    **dict.fromkeys(COMPONENTS, CORE | TOOLS),
    "rivals": CORE | TOOLS | {"recovery.models"},  # a rival may use a model of recovery's
    "trainer": LOOP,
    "config": CORE,
    "runs": LOOP | {"config"},
    **dict.fromkeys(READERS, CORE | {"runs"}),
    "cli": LOOP | READERS | {"config", "runs", "bench", "testing"},
    "bench": LOOP | READERS | {"config", "runs", "cli"},
    "testing": LOOP | READERS | {"config", "runs", "cli"},
    "": {"runs", "envs.registration"},  # credit/__init__.py: what `credit.run` stands for, and our Gymnasium ids
}
ONLY = {  # package → the rooms that know it
    "hydra": {"config", "cli"},
    "hydra_plugins": {"config", "cli"},
    "omegaconf": {"config", "cli"},
    "mlflow": {"tracking"},
}
# What stands against the law today, each with its reason. A line whose import has gone must go, too.
KNOWN: dict[tuple[str, str], str] = {}


def modules() -> Iterator[tuple[str, Path]]:
    """Name, without `credit.`, and file of every module."""
    for path in sorted(HOUSE.rglob("*.py")):
        parts = path.relative_to(HOUSE).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imported(path: Path, name: str) -> set[str]:
    """Full names of all that a module imports; `from a import b` is `a.b` where that is a module, and else `a`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = (
                    ["credit", *name.split(".")] if path.name == "__init__.py" else ["credit", *name.split(".")][:-1]
                )
                base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            for alias in node.names:
                found.add(f"{base}.{alias.name}" if _is_module(f"{base}.{alias.name}") else base)
    return found


def _is_module(name: str) -> bool:
    path = HOUSE.parent.joinpath(*name.split("."))
    return name.startswith("credit.") and (path.with_suffix(".py").exists() or path.is_dir())


def room(name: str) -> str:
    """The room of a module, `recovery.models.linear` → `recovery`; a file at the top is a room of its own."""
    return name.partition(".")[0]


def may(name: str, other: str) -> bool:
    """Whether a module may import another one of credit's."""
    allowed = BELOW[room(name)]
    return room(name) == room(other) or any(f"{other}.".startswith(f"{place}.") for place in allowed)


def against() -> set[tuple[str, str]]:
    """(module, what it imports) of every import against the law."""
    found = set()
    for name, path in modules():
        for other in imported(path, name):
            top, _, inside = other.partition(".")
            if top == "credit" and inside and not may(name, inside):
                found.add((name, inside))
            if room(name) not in ONLY.get(top, {room(name)}):
                found.add((name, top))
    return found


def test_every_room_is_known() -> None:
    assert {room(name) for name, _ in modules()} <= {*BELOW}


def test_no_import_stands_against_the_law() -> None:
    new = sorted(against() - {*KNOWN})
    assert not new, "; ".join(f"credit.{name} imports {other}" for name, other in new)


def test_what_is_known_to_stand_against_the_law_still_does() -> None:
    gone = sorted({*KNOWN} - against())
    assert not gone, f"mended, so remove it from KNOWN: {gone}"

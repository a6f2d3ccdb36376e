"""`credit list`: every registered component, with its parameters and their defaults."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from credit.cli.common import Words
from credit.cli.main import guarded
from credit.cli.output import fitted
from credit.config import classes, files
from credit.config.kinds import CHOICES, KINDS
from credit.config.layers import Layer
from credit.core import signatures
from credit.core.errors import UserError, nearest
from credit.renamed import instead


def main(argv: list[str]) -> int:
    """Print the kinds, or everything of one kind."""
    words = Words.parse(argv)
    known = kinds()
    if words.help:
        print("usage: credit list [KIND] [--config-dir DIR]\n\nkinds: " + ", ".join(known))
        return 0
    for kind in words.overrides:
        require_kind(kind)
    for kind in words.overrides or known:
        print(f"{kind}: {known[kind]}")
        for line in files.twice(kind).values():
            print(f"warning: {line}", file=sys.stderr)
        for name, path in files.options(kind, words.config_dirs).items():
            print(fitted(f"  {name:<18} {files.describe_file(path)}"))
            try:
                files.read(path)
                lines = parameters(kind, path, words.config_dirs) if kind in KINDS else []
            except UserError as error:
                print(f"warning: {kind}={name} is skipped: {error}", file=sys.stderr)
                lines = []
            for line in lines:
                print(fitted(f"  {'':<18}   {line}"))
        print()
    for line in files.broken_packages():
        print(f"warning: a package is skipped: {line}", file=sys.stderr)
    return 0


def kinds() -> dict[str, str]:
    """Kind → what it is, in a line."""
    return {**CHOICES, **{name: kind.help for name, kind in KINDS.items()}}


def require_kind(kind: str) -> None:
    """Refuse a kind that there is not.

    Raises:
        UserError: with the nearest one.
    """
    if now := instead(kind):
        raise UserError(f"{kind!r} is gone; {now}")
    if kind not in kinds():
        raise UserError(f"{kind!r} is no kind; {nearest(kind, kinds())}")


class Parameter(NamedTuple):
    """A key of an option: its default, what its signature allows ("" for a variant of another file), and wishes.

    `elsewhere` is what it is in experiments that say something else, such as `0.3 in pointmaze`, or "".
    """

    name: str
    default: str
    allowed: str
    elsewhere: str


def parameters(kind: str, path: Path, config_dirs: Sequence[str] = ()) -> list[str]:
    """One line a parameter: `name = default   what is allowed; what it is in experiments that say something else`."""
    return [
        f"{name} = {default}" + (f"   ({'; '.join(said)})" if (said := [*filter(None, rest)]) else "")
        for name, default, *rest in described(kind, path, config_dirs)
    ]


def described(kind: str, path: Path, config_dirs: Sequence[str] = ()) -> list[Parameter]:
    """Every key of an option, but for those that hold other components.

    Raises:
        UserError: its file is no YAML, or names no class that may be built.
    """
    node = files.read(path)
    elsewhere = wished(kind, path, node, config_dirs)
    if "_target_" not in node:  # a variant of another file
        values = {key: value for key, value in node.items() if key != "defaults"}
        names = dict.fromkeys([*values, *elsewhere])
        return [Parameter(key, shown(values.get(key, "…")), "", elsewhere.get(key, "")) for key in names]
    hints = classes.parameters(str(path), node)
    return [
        Parameter(name, shown(node.get(name, default)), signatures.describe(hint), elsewhere.get(name, ""))
        for name, (hint, default) in hints.items()
        if signatures.component_kind(hint) is None
    ]


def wished(kind: str, path: Path, node: Mapping[str, Any], config_dirs: Sequence[str]) -> dict[str, str]:
    """Key → what it is in the experiments that say so, such as `0.3 in pointmaze, pointmaze_paper`."""
    found: dict[str, dict[str, list[str]]] = {}
    if path.parents[1] in {folder.resolve() for folder in files.own_dirs(config_dirs)}:
        return {}  # the user's own files are read as they are
    for experiment, layer in _layers(tuple(config_dirs), files.stamp(config_dirs)).items():
        wishes = layer.for_file(f"{kind}/{path.stem}", node)
        for key, value in {wish.key: wish.value for wish in wishes}.items():
            found.setdefault(key, {}).setdefault(shown(value), []).append(experiment)
    return {
        key: ", ".join(f"{value} in {', '.join(names)}" for value, names in values.items())
        for key, values in found.items()
    }


@lru_cache(maxsize=4)
def _layers(config_dirs: tuple[str, ...], stamp: object) -> dict[str, Layer]:
    """What each experiment says of others' keys; one that cannot be read says nothing."""
    found = {}
    for name in files.options("experiment", config_dirs):
        with suppress(UserError):
            found[name] = Layer.of(name, "", config_dirs)
    return found


def shown(value: object) -> str:
    """A value as text."""
    return "null" if value is None else str(value)


if __name__ == "__main__":
    sys.exit(guarded("list", sys.argv[1:]))

"""`credit list`: every registered component, with its parameters and their defaults."""

from __future__ import annotations

import sys
from pathlib import Path

import yaml

from credit.cli.common import Words
from credit.cli.main import guarded
from credit.config import registry, schema, signatures
from credit.core.errors import UserError, nearest


def main(argv: list[str]) -> int:
    """Print the kinds, or everything of one kind."""
    words = Words.parse(argv)
    kinds = {**registry.CHOICES, **{name: kind.help for name, kind in registry.KINDS.items()}}
    if words.help:
        print("usage: credit list [KIND] [--config-dir DIR]\n\nkinds: " + ", ".join(kinds))
        return 0
    for kind in words.overrides:
        if kind not in kinds:
            raise UserError(f"{kind!r} is no kind; {nearest(kind, kinds)}")
    for kind in words.overrides or kinds:
        print(f"{kind}: {kinds[kind]}")
        for name, path in registry.options(kind, words.config_dirs).items():
            print(f"  {name:<18} {registry.describe_file(path)}")
            for line in parameters(path) if kind in registry.KINDS else ():
                print(f"  {'':<18}   {line}")
        print()
    return 0


def parameters(path: Path) -> list[str]:
    """One line a parameter: `name = default   what is allowed`."""
    node = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    if "_target_" not in node:  # a variant of another file
        return [f"{key} = {shown(value)}" for key, value in node.items() if key != "defaults"]
    hints = signatures.signature(schema.resolve(str(path), node))
    return [
        f"{name} = {shown(node.get(name, default))}   ({signatures.describe(hint)})"
        for name, (hint, default) in hints.items()
        if signatures.component_kind(hint) is None
    ]


def shown(value: object) -> str:
    """A default as text; one that experiments set is that of the default experiment."""
    if not str(value).startswith("${tuned."):
        return "null" if value is None else str(value)
    tuned = yaml.safe_load((registry.conf_dir() / "config.yaml").read_text(encoding="utf-8"))["tuned"]
    return f"{tuned[str(value)[8:-1]]} unless the experiment says otherwise"


if __name__ == "__main__":
    sys.exit(guarded("list", sys.argv[1:]))

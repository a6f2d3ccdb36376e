"""The page of all groups and keys, from the YAML files, signatures and docstrings, as `credit list` has them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from arguments import arguments
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from credit.cli.list import Parameter, described, kinds
from credit.config import files as registered
from credit.config import schema
from credit.config.kinds import CHOICES

KEY = re.compile(r"^(?P<indent> *)(?P<key>\w+):(?: +(?P<value>[^#]*?))? *(?:# (?P<comment>.*))?$")
HEAD = """# Configuration

Everything that can be chosen and set, made from the files of `conf/` and the constructors of their classes: `credit
list` shows the same in a terminal, with what your own packages add. `group=option` chooses a part, `key=value` sets a
key, and `credit check` says what is wrong with both.
How they are typed: [Commands](commands.md#how-a-configuration-is-typed).
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page."""
    files.append(File.generated(config, "configuration.md", content="\n".join(page()) + "\n"))
    return files


def page() -> Iterator[str]:
    """Its lines: first the keys of every run, then group by group."""
    yield HEAD
    yield "## Keys of every run\n"
    yield from table(("key", "default", "what it is"), run_keys())
    for kind, said in kinds().items():
        yield f"\n## {kind}\n\n{sentence(said)}\n"
        if kind in CHOICES:
            rows = [(f"`{name}`", escaped(registered.describe_file(path))) for name, path in ours(kind).items()]
            yield from table((f"`{kind}=`", "what it is"), rows)
            continue
        for name, path in ours(kind).items():
            yield f"\n### `{kind}={name}`\n\n{escaped(registered.describe_file(path))}\n"
            yield from options(kind, path)
    yield "\n## hydra/launcher\n\nWhere the jobs of a sweep run: [Cluster](cluster.md).\n"
    for path in sorted((registered.conf_dir() / "hydra" / "launcher").glob("*.yaml")):
        yield f"\n### `hydra/launcher={path.stem}`\n\n{escaped(registered.describe_file(path))}\n"
        rows = [(f"`hydra.launcher.{key}`", code(value), escaped(said)) for key, value, said in commented(path)]
        yield from table(("key", "default", "what it is"), rows)


def sentence(text: str) -> str:
    """A line of help as a sentence."""
    whole = text if text.endswith("…") else f"{text}."
    return escaped(whole[0].upper() + whole[1:])


def ours(kind: str) -> dict[str, Path]:
    """The options of a kind that credit itself has."""
    own = registered.conf_dir()
    return {name: path for name, path in registered.options(kind).items() if path.is_relative_to(own)}


def run_keys() -> list[tuple[str, ...]]:
    """Keys of `config.yaml` that a user sets."""
    path = registered.conf_dir() / "config.yaml"
    internal = {"_target_", "defaults", "hydra", "session", "slug", "written_for", "experiment", "method"}
    return [
        (f"`{key}`", code(value), escaped(said))
        for key, value, said in commented(path)
        if internal.isdisjoint(key.split("."))
    ]


def options(kind: str, path: Path) -> Iterator[str]:
    """The table of an option's keys, where it has any."""
    meanings = meant(kind, path)
    rows = [
        (
            f"`{one.name}`",
            code(one.default) + (f"; {escaped(one.elsewhere)}" if one.elsewhere else ""),
            escaped(one.allowed),
            escaped(meanings.get(one.name, "")),
        )
        for one in keys(kind, path)
    ]
    if rows:
        yield from table(("key", "default", "allowed", "what it is"), rows)


def keys(kind: str, path: Path) -> list[Parameter]:
    """Every key of an option; of a variant, those in which it differs."""
    return described(kind, path)


def meant(kind: str, path: Path) -> dict[str, str]:
    """Key → what it is: the comment beside it, else its class's docstring, else what the file says it starts from."""
    node = registered.read(path)
    found = {key: said for key, _, said in commented(path) if said}
    if "_target_" in node:
        cls = schema.resolve(str(path), node)
        for base in cls.__mro__:
            names = [one.name for one in keys(kind, path)]
            found = arguments(base.__doc__ or "", names) | found
        return found
    for base in registered.bases(kind, node):
        found = meant(kind, registered.options(kind)[base]) | found
    return found


def commented(path: Path) -> list[tuple[str, str, str]]:
    """Key (with its parents), value and comment of every line of a YAML file that holds one."""
    found, above = [], list[tuple[int, str]]()
    for line in path.read_text(encoding="utf-8").splitlines():
        if not (match := KEY.match(line)):
            continue
        depth = len(match["indent"])
        above = [(indent, key) for indent, key in above if indent < depth]
        full = ".".join([*(key for _, key in above), match["key"]])
        if not match["value"]:
            above.append((depth, match["key"]))
            if not match["comment"]:
                continue
        if not full.endswith("_target_") and "defaults" not in full.split("."):
            found.append((full, match["value"] or "", match["comment"] or ""))
    return found


def table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    """A table in Markdown; nothing where there are no rows."""
    if rows:
        yield "| " + " | ".join(heads) + " |"
        yield "|" + "---|" * len(heads)
        yield from ("| " + " | ".join(row) + " |" for row in rows)


def code(value: str) -> str:
    """A value as code; nothing where there is none."""
    return "required" if value == "???" else f"`{value}`".replace("|", "\\|") if value else ""


def escaped(text: str) -> str:
    """Text in a cell of a table: no character of it is markup."""
    return re.sub(r"([|*_<>\[\]`~])", r"\\\1", text)

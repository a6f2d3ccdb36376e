"""`credit show method=disagreement`: what an option is: its file, its parts, their equations, and what it changes."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from credit.cli.common import Words
from credit.cli.list import parameters, shown
from credit.cli.main import guarded
from credit.cli.output import fitted
from credit.config import answers, classes, files, registry
from credit.config.kinds import CHOICES, KINDS
from credit.core import source
from credit.core.errors import UserError, nearest
from credit.core.naming import flat

USAGE = """\
usage: credit show KIND=OPTION ... [--config-dir DIR]

what a method, an experiment or any part is; several words are one job:
credit show experiment=sepsis method=reference"""
QUIET = ("slug", "title", "method", "experiment", "written_for")  # names, which a heading shows already


def main(argv: list[str]) -> int:
    """Show every option that is named."""
    words = Words.parse(argv)
    if words.help:
        print(USAGE)
        return 0
    named = [(kind, option) for kind, option in map(_read, words.overrides) if kind]
    if not named or len(named) < len(words.overrides):
        raise UserError(f"KIND=OPTION is needed, got {' '.join(words.overrides) or 'nothing'}; {_kinds()}\n{USAGE}")
    for kind, option in named:
        require(kind, option, words.config_dirs)
    for number, (kind, option) in enumerate(named):
        lines = choice if kind in CHOICES else part
        print("\n" * (number > 0) + "\n".join(map(fitted, lines(kind, option, words.overrides, words.config_dirs))))
    return 0


def _read(word: str) -> tuple[str, str]:
    kind, equals, option = word.lstrip("+").partition("=")
    return (kind.partition("@")[0], option.strip("[] ")) if equals else ("", "")


def _kinds() -> str:
    return f"kinds: {', '.join([*CHOICES, *KINDS])}"


def require(kind: str, option: str, config_dirs: Sequence[str]) -> None:
    """Refuse what is not there.

    Raises:
        UserError: with the nearest kind or option.
    """
    if kind not in {**CHOICES, **KINDS}:
        raise UserError(f"{kind!r} is no kind; {nearest(kind, [*CHOICES, *KINDS])}")
    if option not in files.options(kind, config_dirs):
        raise UserError(answers.no_option(kind, option, config_dirs))


def part(kind: str, option: str, words: Sequence[str], config_dirs: Sequence[str]) -> list[str]:
    """A component: what its class says, and its keys."""
    path = files.options(kind, config_dirs)[option]
    node = classes.node_of_option(kind, option, config_dirs)
    target = str(node.get("_target_", ""))
    found = [f"{kind}={option}   {files.describe_file(path)}", f"file     {_shown(path)}"]
    if target:
        found += [f"class    {target}", "", *_indented(docstring(target, path, node))]
    keys = parameters(kind, path, config_dirs)
    return [*found, "", "keys", *_indented("\n".join(keys))] if keys else found


def choice(kind: str, option: str, words: Sequence[str], config_dirs: Sequence[str]) -> list[str]:
    """A method, an experiment or a sweep: the parts that it comes to, and what differs without it."""
    path = files.options(kind, config_dirs)[option]
    found = [f"{kind}={option}   {files.describe_file(path)}", f"file     {_shown(path)}"]
    if kind == "sweep":
        return [*found, "", *_indented(path.read_text(encoding="utf-8"))]
    said = f"{kind}={option}"
    with_it = registry.compose(words, config_dirs)
    without = registry.compose([word for word in words if word != said], config_dirs)
    found += ["", "parts", *_indented("\n".join(_parts(with_it)))]
    differences = [f"{key} = {new}   ({old})" for key, old, new in _differences(without, with_it)]
    base = f"{without['experiment']}, {without['method']}"
    title = f"what it changes (in brackets: without it, {base})"
    return [*found, "", title, *_indented("\n".join(differences or ["nothing: it is the default"]))]


def docstring(target: str, path: Path, node: Mapping[str, Any]) -> str:
    """What a class says of itself; imported only where its source is not ours."""
    said = source.documented(target)
    return said if said is not None else inspect.getdoc(classes.resolve(str(path), node)) or ""


def _parts(config: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Each component with the first line of its class."""
    for key, value in config.items():
        if not isinstance(value, Mapping):
            continue
        name = f"{prefix}{key}"
        if classes.is_component(value):
            first = docstring(str(value["_target_"]), Path(name), value).partition("\n")[0]
            yield f"{name:<22} {str(value['_target_']).rpartition('.')[2]}: {first}"
        yield from _parts(value, f"{name}.")


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Keys whose values differ, with both values, `–` where there was none; not those that go with their part."""
    before, after = ({key: shown(value) for key, value in flat("", config)} for config in (old, new))
    for key, now in after.items():
        if key not in QUIET and (then := before.get(key, "–")) != now:
            yield key, then, now
    yield from ((part, name, "–") for part, name in _gone(old, new))


def _gone(old: Mapping[str, Any], new: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """The parts that only the old one has, without what they hold."""
    for key, value in old.items():
        if not isinstance(value, Mapping):
            continue
        there = new.get(key)
        if classes.is_component(value) and there is None:
            yield f"{prefix}{key}", dict(flat("", {key: value}))[key]
        elif there is not None:
            yield from _gone(value, there if isinstance(there, Mapping) else {}, f"{prefix}{key}.")


def _indented(text: str) -> list[str]:
    return [f"  {line}".rstrip() for line in text.splitlines()]


def _shown(path: Path) -> str:
    home = files.conf_dir().parent
    return str(path.relative_to(home)) if path.is_relative_to(home) else str(path)


if __name__ == "__main__":
    sys.exit(guarded("show", sys.argv[1:]))

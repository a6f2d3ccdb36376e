"""The folders of YAML files: ours, those of packages that announced themselves, and the user's own."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cache, lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import yaml

from credit.core.errors import UserError

CONFIG_NAME = "config"


def conf_dir() -> Path:
    """The folder of YAML files: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next(path for path in (package / "conf", package.parent / "conf") if path.is_dir())


@cache
def package_dirs() -> tuple[Path, ...]:
    """The folders `conf` of packages that announced themselves by an entry point."""
    found: list[Path] = []
    for point in entry_points(group="credit.components"):
        try:
            spec = importlib.util.find_spec(point.module)
        except Exception:  # its parent is not there, or raises: who uses a part of it is told so
            spec = None
        places = (spec.submodule_search_locations or []) if spec else []
        found.extend(folder for place in places if (folder := Path(place) / "conf").is_dir())
    return tuple(found)


def own_dirs(config_dirs: Sequence[str]) -> list[Path]:
    """The user's own folders, absolute.

    Raises:
        UserError: one is not there.
    """
    for name in config_dirs:
        if not Path(name).is_dir():
            raise UserError(f"--config-dir {name}: no such folder; give a folder with sub-folders like {conf_dir()}")
    return [Path(name).resolve() for name in config_dirs]


def search_path(config_dirs: Sequence[str] = ()) -> list[Path]:
    """All folders, what counts most first: the user's own (the last given before the others), ours, packages'."""
    return [*reversed(own_dirs(config_dirs)), conf_dir(), *package_dirs()]


def broken_packages() -> list[str]:
    """What announced itself and is not there: one sentence each."""
    found = []
    for point in entry_points(group="credit.components"):
        try:
            there = importlib.util.find_spec(point.module) is not None
        except Exception as error:  # whatever somebody's own package may raise
            found.append(f"{point.module} (entry point {point.name!r}): {type(error).__name__}: {error}")
        else:
            found += [] if there else [f"{point.module} (entry point {point.name!r}): there is no such module"]
    return found


def twice(kind: str) -> dict[str, str]:
    """Names that several packages have, or a package and credit itself → where each stands, in a sentence."""
    found: dict[str, list[Path]] = {}
    for folder in search_path() if package_dirs() else []:
        for path in sorted((folder / kind).glob("*.yaml")):
            found.setdefault(path.stem, []).append(path)
    return {
        name: f"{kind}={name} means several parts: {', '.join(map(str, paths))}"
        for name, paths in found.items()
        if len(paths) > 1
    }


def options(kind: str, config_dirs: Sequence[str] = ()) -> dict[str, Path]:
    """Name → YAML file of everything registered under a kind."""
    folders = [folder / kind for folder in reversed(search_path(config_dirs))]
    return {path.stem: path for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.yaml"))}


def read(path: Path) -> dict[str, Any]:
    """A YAML file as a mapping.

    Raises:
        UserError: it is no YAML, or no mapping.
    """
    found = path.stat()
    return deepcopy(_read(path, found.st_mtime_ns, found.st_size))


class _Loader(yaml.SafeLoader):
    """A loader of plain data that refuses a key which is written twice, as Hydra does; PyYAML takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and (first := lines.setdefault(key.value, at := _line(key))) != at:
                raise yaml.YAMLError(f"the key {key.value} is written twice, in lines {first} and {at}")
        return super().construct_mapping(node, deep)


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


@lru_cache(maxsize=1024)  # a list of all parts reads each file a hundred times
def _read(path: Path, changed: int, size: int) -> dict[str, Any]:
    try:
        found = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader) or {}
    except UnicodeDecodeError as error:
        raise UserError(_no_text(path, error)) from None
    except yaml.YAMLError as error:
        raise UserError(f"{path}: no YAML ({' '.join(str(error).split())}); mend it, or take it away") from None
    if not isinstance(found, dict):
        raise UserError(f"{path}: a mapping belongs here, key: value")
    return found


def bases(kind: str, node: Mapping[str, Any]) -> list[str]:
    """The options of its own kind that a file starts from."""
    entries = [entry for entry in node.get("defaults") or () if isinstance(entry, str) and entry != "_self_"]
    return [entry.removeprefix(f"/{kind}/") for entry in entries]


def package_of(kind: str, option: str, config_dirs: Sequence[str]) -> str | None:
    """Where a file says that it is put, or one that it starts from; None where none of them does."""
    path = options(kind, config_dirs).get(option)
    if path is None:
        return None
    said = re.match(r"#\s*@package\s+(\S+)", path.read_text(encoding="utf-8", errors="replace"))
    others = (base for base in bases(kind, read(path)) if base != option) if not said else ()
    return said[1] if said else next(filter(None, (package_of(kind, base, config_dirs) for base in others)), None)


def circular(kind: str, config_dirs: Sequence[str]) -> list[Path]:
    """Files that start from themselves, by way of others or at once."""
    known = options(kind, config_dirs)
    graph = {name: [base for base in bases(kind, read(path)) if base in known] for name, path in known.items()}

    def reached(name: str) -> set[str]:
        found, left = set[str](), list(graph[name])
        while left:
            if (base := left.pop()) not in found:
                found.add(base)
                left += graph[base]
        return found

    return [known[name] for name in graph if name in reached(name)]


def describe_file(path: Path) -> str:
    """The first comment line of a YAML file: what it is."""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("#") and not line.startswith("# @package"):
            return line.lstrip("# ").strip()
    return ""


def undecodable(config_dirs: Sequence[str]) -> list[str]:
    """Files that are no UTF-8: one sentence each."""
    found = []
    for folder in search_path(config_dirs):
        for path in sorted(folder.rglob("*.yaml")):
            try:
                path.read_text(encoding="utf-8")
            except UnicodeDecodeError as error:
                found.append(_no_text(path, error))
    return found


def _no_text(path: Path, error: UnicodeDecodeError) -> str:
    byte = f"byte {error.object[error.start]:#04x} at {error.start}"
    return f"{path}: no UTF-8 ({byte}); save it as UTF-8"


def stamp(config_dirs: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """What changes when a file does: every file, and when it was written."""
    files = [file for folder in search_path(config_dirs) for file in folder.rglob("*.yaml")]
    return tuple((str(file), file.stat().st_mtime_ns) for file in sorted(files))

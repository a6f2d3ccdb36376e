"""What every file of a component owes its reader: a class of its kind, words, comments, and no key too many."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from credit.config import files, kinds, registry, schema
from credit.config.identity import plain
from credit.core import signatures

from .short import FILES, selection


def nodes(kind: str, name: str) -> dict[str, Any]:
    """Path → configuration of the components that an option makes."""
    config = registry.compose(["tracking=none", *selection(kind, name)])
    if kind == "features":
        return {"reference.features": config["reference"]["features"]}
    return schema.members(config, "reference" if kind == "reward" else kind)


def classes(kind: str, name: str) -> list[type]:
    return [schema.resolve(path, node) for path, node in nodes(kind, name).items()]


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_class_kind_and_words(kind: str, name: str) -> None:
    assert files.describe_file(files.options(kind)[name])
    for cls in classes(kind, name):
        assert issubclass(cls, kinds.KINDS[kind].load())
        assert not inspect.isabstract(cls)
        assert cls.__doc__
        assert cls.__doc__.strip().splitlines()[0].strip()


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_has_a_value_and_every_key_a_parameter(kind: str, name: str) -> None:
    slots = {slot for other in kinds.KINDS.values() for slot in other.slots}
    for cls, node in zip(classes(kind, name), nodes(kind, name).values(), strict=True):
        parameters = signatures.signature(cls)
        assert node.keys() - {"_target_"} <= parameters.keys()
        for parameter, (hint, default) in parameters.items():
            assert parameter in node or default is not signatures.REQUIRED or parameter in slots, parameter
            assert hint is not Any, f"{parameter} has no type hint"


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_is_documented(kind: str, name: str) -> None:
    for cls in classes(kind, name):
        for parameter in signatures.signature(cls):
            assert f"{parameter}:" in (cls.__doc__ or ""), parameter


@cache
def written() -> dict[type, list[dict[str, Any]]]:
    """Class → what each of its files says."""
    found: dict[type, list[dict[str, Any]]] = {}
    for kind, name in FILES:
        node = files.read(files.options(kind)[name])
        if "_target_" in node:
            found.setdefault(schema.resolve(name, node), []).append(node)
    return found


@pytest.mark.parametrize("cls", written(), ids=lambda cls: cls.__name__)
def test_a_default_has_one_spelling(cls: type) -> None:
    """The constructor's is that of the file; of a class with several recipes, that of one of them."""
    for parameter, (hint, default) in signatures.signature(cls).items():
        values = [plain(node[parameter]) for node in written()[cls] if parameter in node]
        if values and default is not signatures.REQUIRED and not signatures.component_kind(hint):
            assert plain(default) in values, parameter
            assert len(written()[cls]) > 1 or values == [plain(default)], parameter


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_a_variant_says_what_differs_and_nothing_else(kind: str, name: str) -> None:
    node = files.read(files.options(kind)[name])
    for base in files.bases(kind, node):
        before = registry.compose(["tracking=none", *selection(kind, base)])
        now = registry.compose(["tracking=none", *selection(kind, name)])
        slot = "reference" if kind == "reward" else kind
        for key in node.keys() - {"defaults", "_target_"}:
            there, here = (next(iter(schema.members(config, slot).values())) for config in (before, now))
            assert there.get(key, "…") != here[key], key


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


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_key_has_a_comment(kind: str, name: str) -> None:
    assert keys_without_comment(files.options(kind)[name]) == []

"""What every file of a component owes its reader: a class of its kind, words, comments, and no key too many."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from credit.config import classes, files
from credit.config.identity import plain
from credit.core import signatures
from credit.testing import words

from .short import FILES


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_class_kind_and_words(kind: str, name: str) -> None:
    words.is_described(kind, name)


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_has_a_value_and_every_key_a_parameter(kind: str, name: str) -> None:
    words.is_complete(kind, name)


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_parameter_is_documented(kind: str, name: str) -> None:
    words.is_documented(kind, name)


@cache
def written() -> dict[type, list[dict[str, Any]]]:
    """Class → what each of its files says."""
    found: dict[type, list[dict[str, Any]]] = {}
    for param in FILES:
        kind, name = map(str, param.values)
        node = files.read(files.options(kind)[name])
        if "_target_" in node:
            found.setdefault(classes.resolve(name, node), []).append(node)
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
    words.says_what_differs(kind, name)


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_every_key_has_a_comment(kind: str, name: str) -> None:
    words.is_commented(kind, name)

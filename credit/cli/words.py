"""KEY=VALUE words of commands that are not configurations: `credit compare`, `credit dashboard`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from credit.core.errors import UserError, nearest

Reader = tuple[str, Callable[[str], Any], str]  # argument that is filled, how its text is read, what is allowed


def read_words(argv: Sequence[str], readers: Mapping[str, Reader], command: str) -> dict[str, Any]:
    """The arguments that KEY=VALUE words give.

    Args:
        argv: the words. readers: key → how it is read. command: for the message.

    Raises:
        UserError: with every word that cannot be read.
    """
    arguments: dict[str, Any] = {}
    problems = []
    given: dict[str, str] = {}
    for word in argv:
        key, equals, text = word.partition("=")
        if not equals:
            problems.append(f"{word!r} is not of the form KEY=VALUE")
        elif key in given:
            problems.append(f"{key} is given twice ({given[key]!r} and {word!r}); leave one of them out")
        elif key not in readers:
            problems.append(f"unknown key {key!r} (in {word!r}); {nearest(key, readers)}")
        else:
            argument, reader, allowed = readers[key]
            try:
                arguments[argument] = reader(text)
            except (ValueError, KeyError):
                problems.append(f"{key}={text}: expected {allowed}")
        given.setdefault(key, word)
    if problems:
        raise UserError("\n".join([*problems, f"`credit {command} --help` lists what can be set"]))
    return arguments


def names(text: str) -> list[str]:
    """Names separated by commas."""
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise ValueError(text)
    return names


def name(text: str) -> str:
    """One name."""
    (name,) = names(text)
    return name


def given(text: str) -> str:
    """A text that is not empty."""
    if not text.strip():
        raise ValueError(text)
    return text


def number(text: str) -> float:
    """A finite number."""
    if not math.isfinite(found := float(text)):
        raise ValueError(text)
    return found


def whole(least: int) -> Callable[[str], int]:
    """A reader of whole numbers that are not below `least`."""

    def read(text: str) -> int:
        if int(text) < least:
            raise ValueError(text)
        return int(text)

    return read

"""The two ways in which a user's request can end badly."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from functools import partial

RAISED = (Exception, SystemExit)  # whatever a part may raise: one that ends Python would end credit without a word


class UserError(ValueError):
    """Something the user asked for cannot be done; the message says what, why, and what to do.

    The command line prints it without a traceback and exits with code 2. What is valid in several of its lines is
    listed in the last of them.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(listed_once(message))


class UnknownKey(UserError):
    """A key that nothing has."""


class Misfit(UserError):
    """Parts that do not go with a problem.

    Attributes:
        parts: where each stands among those that hold it (`assigner.reference.features`), and what is wrong with it.
    """

    def __init__(self, parts: Sequence[tuple[str, str]]) -> None:
        super().__init__("\n".join(f"{path}: {what}" for path, what in parts))
        self.parts = tuple(parts)


class RunError(RuntimeError):
    """A run had to stop: the message names the window or component and the value; status becomes FAILED."""


LISTING = re.compile(r"(?:;? )?(\(valid: [^()\n]*\))")


def listed_once(message: str) -> str:
    """A message whose lines repeat no list of what is valid that a later line has, too.

    Example:
        >>> listed_once("a: unknown; (valid: x, y)\\nb: unknown; did you mean 'x'? (valid: x, y)")
        "a: unknown\\nb: unknown; did you mean 'x'? (valid: x, y)"
    """
    lines = message.split("\n")
    for place, line in enumerate(lines):
        behind = {found[1] for later in lines[place + 1 :] for found in LISTING.finditer(later)}
        lines[place] = LISTING.sub(partial(_unless, behind), line)
    return "\n".join(lines)


def _unless(there: set[str], found: re.Match[str]) -> str:
    return "" if found[1] in there else found[0]


def nearest(name: str, valid: Iterable[str]) -> str:
    """The valid names, with the closest one first where there is one.

    Example:
        >>> nearest("alpa", ["alpha", "epsilon"])
        "did you mean 'alpha'? (valid: alpha, epsilon)"
    """
    names = sorted(set(valid))
    if not names:
        return "(there are none)"
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    listing = f"valid: {', '.join(names)}"
    return f"did you mean {close[0]!r}? ({listing})" if close else f"({listing})"

"""Variants of a method: what the name of a run's folder says beside the setting, and how one is asked for by name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Iterator

from credit.core.errors import UserError
from credit.report.settings import GIVEN, PROBLEM, SCHEDULE, TRAINER

SHOWN = 5  # names in a message
# tuned.window and tuned.noise reach nothing but the feedback
_MAKES_SETTING = re.compile(
    rf"[+~]*(({'|'.join(PROBLEM)})[.=@]|tuned\.(window|noise)=|{TRAINER}\.(?!({'|'.join(SCHEDULE)})=)|{GIVEN}=)"
)
# a comma stands before another override only where a key follows: lists have commas too
_BETWEEN = re.compile(r",(?=[+~]|[^,=]*=)")
_DECIMAL = re.compile(r"(?<==)[+-]?(\d+\.\d*|\.\d+|\d+(?=e))(e[+-]?\d+)?$")
_OVERRIDE = re.compile(r"[+~]|[^,=]+=")


def overrides(slug: str) -> list[str]:
    """The overrides of a slug, none of `default`: `bonus=[a,b],mixer.alpha=0.1` has two.

    Args:
        slug: the name of a run's folder, or of a variant.
    """
    return [] if slug == "default" else _BETWEEN.split(slug)


def variant(slug: str) -> str:
    """What a slug says of a method, without the overrides that make the setting: `default` where nothing is left.

    Args:
        slug: the name of a run's folder, overrides separated by commas.
    """
    return ",".join(part for part in overrides(slug) if not _MAKES_SETTING.match(part)) or "default"


def spelled(name: str, known: Collection[str]) -> str:
    """A name as it is known, where it is: overrides in the order of folder names, `.1` as `0.1`.

    Args:
        name: as it was typed. known: names of variants.
    """
    if name in known:
        return name
    found = joined(overrides(name))
    return found if found in known else name


def joined(words: Iterable[str]) -> str:
    """Overrides as one name, as folders spell it: in their order, without brackets and quotes, `.1` as `0.1`."""
    bare = [re.sub(r"[\[\]'\"]", "", word) for word in words]
    return ",".join(sorted(_DECIMAL.sub(lambda match: repr(float(match[0])), word) for word in bare))


def nearest_of(name: str, known: Collection[str]) -> str:
    """The known names that are closest to one that is not; there may be many more of them."""
    close = difflib.get_close_matches(name, known, n=SHOWN, cutoff=0.0)
    meant = f"did you mean {close[0]!r}? " if difflib.get_close_matches(name, close[:1], cutoff=0.5) else ""
    more = f" and {len(known) - len(close)} more" if len(known) > len(close) else ""
    return f"{meant}(valid: {', '.join(close)}{more})"


def choose_variants(texts: Iterable[str], known: Collection[str], experiment: str) -> set[str]:
    """The names of variants that were asked for; one with commas in it is a name first, and a list else.

    Args:
        texts: names, or several with commas between. known: names of variants, with and without what makes the setting.
        experiment: for messages.

    Raises:
        UserError: a name is none of those known, or a text may be one name that is none of them, or several that are.

    Example:
        >>> choose_variants(["a=1,b=2", "default,x"], ["a=1", "b=2", "a=1,b=2", "default", "x"], "mine")
        {'a=1,b=2', 'default', 'x'}
    """
    chosen = set[str]()
    for typed in texts:
        text = spelled(typed, known)
        readings = [(text,)] if text in known else list(_readings(text.split(","), known))
        keys = [part.partition("=")[0] for part in overrides(text)]
        one = len(keys) > 1 and len(keys) == len(set(keys)) and bool(_OVERRIDE.match(text))
        if not readings:
            name = text if one else next((part for part in text.split(",") if part not in known), text)
            raise UserError(
                f"variant={typed}: experiment={experiment} has no runs of a variant {name!r}; {nearest_of(name, known)}"
            )
        if text not in known and (one or len(readings) > 1):
            several = " ".join(f"variant={name}" for name in readings[0])
            raise UserError(
                f"variant={typed}: experiment={experiment} has no runs of a variant of this name; if it is a list, "
                f"write {several}"
            )
        chosen |= {*readings[0]}
    return chosen


def _readings(parts: list[str], known: Collection[str]) -> Iterator[tuple[str, ...]]:
    """All ways to read pieces between commas as known names."""
    if not parts:
        yield ()
    for length in range(1, len(parts) + 1):
        if (name := ",".join(parts[:length])) in known:
            yield from ((name, *rest) for rest in _readings(parts[length:], known))

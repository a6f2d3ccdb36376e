"""What is typed has an effect or is an error: words for parts that a run does not use."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress

from credit.config import files, registry
from credit.config.kinds import KINDS, SLOTS
from credit.core.errors import UserError
from credit.runs import job as jobs


def idle(overrides: Sequence[str], used: Collection[str]) -> dict[str, str]:
    """Word → slot, of words for slots that a run does not use.

    Args:
        overrides: as they were typed. used: the slots that the run uses.

    Example:
        >>> idle(["method=delayed", "mixer.alpha=.3"], {"env", "feedback", "assigner", "agent"})
        {'mixer.alpha=.3': 'mixer'}
    """
    return {word: slots[0] for word in overrides if (slots := _slots(word)) and not set(slots) & set(used)}


def refuse(words: dict[str, str], overrides: Sequence[str], config_dirs: Sequence[str] = ()) -> None:
    """Say that words have no effect, and with which methods they would have one.

    Raises:
        UserError: there are such words.
    """
    if words:
        raise UserError("\n".join(said(word, slot, overrides, config_dirs) for word, slot in words.items()))


def _slots(word: str) -> tuple[str, ...]:
    """The slots that a word reaches into."""
    parsed = registry.parse(word)
    first = str(parsed.package or parsed.key_or_group).partition(".")[0]
    if parsed.package is None and first in KINDS and "." not in parsed.key_or_group:
        return KINDS[first].slots
    return (first,) if first in SLOTS else ()


def said(word: str, slot: str, overrides: Sequence[str], config_dirs: Sequence[str]) -> str:
    """That a word has no effect in a job, and with which methods it would have one."""
    method = registry.compose(overrides, config_dirs)["method"]
    others = [text for text in overrides if registry.parse(text).key_or_group in ("experiment", "env", "feedback")]
    with_it = [
        name
        for name in files.options("method", config_dirs)
        if slot in _reached([*others, f"method={name}"], config_dirs)
    ]
    hint = f"methods that do: {', '.join(with_it)}" if with_it else "no method does here"
    return f"{word!r} has no effect: method={method} uses no {slot}; leave it out ({hint})"


def _reached(words: Sequence[str], config_dirs: Sequence[str]) -> set[str]:
    """The slots that a run of these words would use; none where they do not go together."""
    with suppress(UserError):
        return jobs.schema_of(registry.compose(words, config_dirs)).used
    return set()

"""What things are called in sentences, tables and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from credit.logged.claims import HELD
from credit.logged.panel import MIXTURE
from credit.logged.report.numbers import short

NAMED = 5  # things that are listed in a sentence


def called(model: str) -> str:
    """A model in words, so that it is not taken for what it is called after."""
    return model if model == MIXTURE else f"model “{short(model)}”"


def named(line: Mapping[Any, Any], most: int = 40) -> str:
    """An action, or one of its categories, in few words."""
    return short(line["action"] if line["level"] is None else f"{line['action']} = {line['level']}", most)


def numberless(line: Mapping[Any, Any]) -> bool:
    """Whether an effect has a note in the place of a number."""
    return bool(line["note"]) and not str(line["note"]).startswith(HELD)


def listed(words: Sequence[str], most: int = NAMED) -> str:
    """Words with commas between them, and how many more there are."""
    shown = [short(word, 300) for word in words[:most]]
    if len(words) > most:
        shown.append(f"{len(words) - most} more")
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)

"""Parts that do not go with a problem, by the keys that a user types, and the options that would go with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from credit.config import files, schema
from credit.config.kinds import KINDS, SLOTS
from credit.core.capabilities import misfits
from credit.core.errors import Misfit
from credit.core.problem import Problem


def key_of(path: str) -> str:
    """The key of a part, of where it stands among those that hold it.

    Example:
        >>> key_of("assigner.reference.features")
        'reference.features'
        >>> key_of("agent.transition")
        'transition'
    """
    names = path.split(".")
    return ".".join(names[max((i for i, name in enumerate(names) if name in SLOTS), default=0) :])


def said(error: Misfit, problem: Problem, knowledge: Any, config_dirs: Sequence[str] = ()) -> list[str]:
    """What is wrong with each part, by its key, and which options of its kind would go with the problem."""
    return [
        f"{(key := key_of(path))}: {what}{_hint(key, problem, knowledge, config_dirs)}" for path, what in error.parts
    ]


def _hint(key: str, problem: Problem, knowledge: Any, config_dirs: Sequence[str]) -> str:
    first, last = key.partition(".")[0], key.rpartition(".")[2]
    kind = last if last in KINDS else SLOTS.get(first)
    if kind is None:
        return ""
    found = [
        name
        for name in files.options(kind, config_dirs)
        if (made := schema.made_option(kind, name, config_dirs)) is not None
        and not misfits(made, problem)
        and (made.knows is None or isinstance(knowledge, made.knows))
    ]
    return f" ({kind}=… that goes with it: {', '.join(found)})" if found else ""

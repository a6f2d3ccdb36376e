"""What decides a run's results: kinds, registered names, and the parameters that are not their constructor's defaults.

Neither Python paths nor titles nor circumstances are part of it, so that a move, a new title, or a new key with a
neutral default leaves every finished run what it was.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from credit.config import classes
from credit.config.kinds import CIRCUMSTANCES, KINDS, STARTS
from credit.core.errors import UserError
from credit.core.naming import registered_name
from credit.core.signatures import REQUIRED, signature
from credit.renamed import translated

EXACT = 2**53  # up to which every whole number is a float
SLOTS = ("trainer", *(slot for kind in KINDS.values() for slot in kind.slots))


def identity(config: Mapping[str, Any]) -> str:
    """Hash of everything that decides a run's results but its seed; 12 hexadecimal digits.

    Args:
        config: a composed and checked configuration, of this version or an older one.
    """
    config = translated(config)
    kept = {slot: described(config[slot]) for slot in SLOTS if config.get(slot) and slot not in CIRCUMSTANCES}
    kept |= {key: plain(config[key]) for key in STARTS if config.get(key) is not None}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:12]


def described(node: Any) -> Any:
    """A component by its registered name and what differs from its defaults; components by name; or a value."""
    if isinstance(node, Mapping) and "_target_" in node:
        cls = classes.resolve("", node)
        defaults = {name: default for name, (_, default) in signature(cls).items()}
        values = {key: value for key, value in node.items() if key != "_target_"}
        changed = {k: described(v) for k, v in values.items() if plain(v) != plain(defaults.get(k, REQUIRED))}
        return {"is": registered_name(cls.__module__, cls.__name__), **changed}
    if isinstance(node, Mapping):
        return {str(key): described(value) for key, value in node.items()}
    return plain(node)


def namesakes(one: Any, other: Any) -> Iterator[tuple[str, str]]:
    """Targets of two configurations with one identity that are two classes all the same; one that moved is not there.

    Args:
        one, other: nodes of configurations.
    """
    if not (isinstance(one, Mapping) and isinstance(other, Mapping)):
        return
    targets = str(one.get("_target_")), str(other.get("_target_"))
    if targets[0] != targets[1]:
        with suppress(UserError):
            if classes.resolve("", one) is not classes.resolve("", other):
                yield targets
    for key in one.keys() & other.keys():
        yield from namesakes(one[key], other[key])


def plain(value: Any) -> Any:
    """Numbers as numbers, sequences as lists: 1, 1.0 and the same from YAML are one value."""
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, (int, float)):
        exact = isinstance(value, float) or abs(value) <= EXACT  # a row of a maze is a number of many digits
        return float(value) if exact else value
    return [plain(inner) for inner in value] if isinstance(value, (list, tuple)) else value

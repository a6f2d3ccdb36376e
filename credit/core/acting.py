"""What an agent's policies look at, as plain data: one replica's part of it, and laid over a state made anew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from credit.core.state import LEFT, PLAIN, Packed

RULE = "replicas must be the leading dimension of tensors [R, ...], or stand in a list of R"


def laid_over(fresh: Packed, kept: Packed) -> Packed:
    """The state that `start` has made, with what was kept of another in its place.

    Args:
        fresh: the whole state of a started object. kept: what `Stateful.acting` gave of one like it.
    """
    if _left(kept):
        return fresh
    if isinstance(fresh, Mapping) and isinstance(kept, Mapping):
        return {**fresh, **{key: laid_over(fresh.get(key), value) for key, value in kept.items()}}
    if isinstance(fresh, (list, tuple)) and isinstance(kept, (list, tuple)) and len(fresh) == len(kept):
        return type(kept)(laid_over(*pair) for pair in zip(fresh, kept, strict=True))
    return kept


def alone(kept: Packed, replica: int, replicas: int, one: Packed, where: str = "the agent") -> Packed:
    """One replica's part of what was kept of R side by side.

    Replicas are the leading dimension of tensors [R·k, ...], or stand in a list, R·k of them.

    Args:
        kept: what `Stateful.acting` gave. replica, replicas: which, of how many. one: what it gives of one seed alone,
            which shows what of it belongs to a replica.
        where: for messages.

    Raises:
        ValueError: a part is neither.
    """
    if replicas == 1 or _left(kept):
        return kept
    if isinstance(kept, Mapping):
        held = one if isinstance(one, Mapping) else {}
        return {key: alone(value, replica, replicas, held.get(key), f"{where}.{key}") for key, value in kept.items()}
    if isinstance(kept, (list, tuple)):
        return _of_list(kept, replica, replicas, one if isinstance(one, (list, tuple)) else (), where)
    return kept if kept is None or type(kept) in PLAIN else _rows(kept, replica, replicas, one, where)


def _of_list(kept: Any, replica: int, replicas: int, one: Any, where: str) -> Packed:
    if len(one) and len(kept) == replicas * len(one):
        return kept[replica * len(one) : (replica + 1) * len(one)]
    if len(kept) != len(one):
        raise ValueError(f"{where} holds {len(kept)} parts, and of one seed alone {len(one)}: {RULE}")
    pairs = enumerate(zip(kept, one, strict=True))
    return type(kept)(alone(part, replica, replicas, like, f"{where}[{i}]") for i, (part, like) in pairs)


def _rows(kept: Any, replica: int, replicas: int, one: Any, where: str) -> Any:
    """Of a tensor [R·k, ...] the k rows of a replica."""
    shape, alike = tuple(kept.shape), tuple(getattr(one, "shape", ()))
    if shape == alike:  # the same for all
        return kept
    rows = alike[0] if alike and alike[1:] == shape[1:] else 1  # where the rest differs, it has grown
    if not shape or shape[0] != replicas * rows:
        raise ValueError(f"{where} has the shape {list(shape)}, and of one seed alone {list(alike)}: {RULE}")
    return kept[replica * rows : (replica + 1) * rows].clone()


def _left(kept: Packed) -> bool:
    return isinstance(kept, list) and kept[:1] == LEFT[:1]

"""What environments tell components that ask for it by name, so that no component is ever given the environment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from credit.core.component import Component
from credit.core.errors import UserError


@dataclass(frozen=True)
class KnownTransitions:
    """P itself: for oracles of planners.

    Attributes:
        backup: values [..., S] → Σ P(s'|s, a) v(s') [..., S, A].
    """

    backup: Callable[[Tensor], Tensor]


def inform(parts: Iterable[Component], knowledge: object, environment: str = "this environment") -> None:
    """Give every component that knows something the knowledge that it asks for; before it is started.

    Args:
        parts: components, as `components` finds them. knowledge: what the environment gives, None for nothing.
        environment: what messages call it.

    Raises:
        UserError: a component knows another environment.
    """
    for part in parts:
        wanted = part.knows
        if wanted is None:
            continue
        if not isinstance(knowledge, wanted):
            given = "nothing" if knowledge is None else f"{type(knowledge).__name__}"
            raise UserError(
                f"{type(part).__name__} needs {wanted.__name__}, and {environment} gives {given}: it is made for "
                "another environment; choose another component in its place, or the environment that it knows"
            )
        part.learn(knowledge)


def components(root: Component) -> Iterator[Component]:
    """A component and all that it holds, in attributes, lists and mappings, each once."""
    seen: set[int] = set()

    def walk(value: Any) -> Iterator[Component]:
        if isinstance(value, Component):
            if id(value) in seen:
                return
            seen.add(id(value))
            yield value
            for inner in vars(value).values():
                yield from walk(inner)
        elif isinstance(value, Mapping):
            for inner in value.values():
                yield from walk(inner)
        elif isinstance(value, (list, tuple)):
            for inner in value:
                yield from walk(inner)

    yield from walk(root)

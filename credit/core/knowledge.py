"""What environments tell components that ask for it by name, so that no component is ever given the environment."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

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
        parts: components, as `parts_of` finds them. knowledge: what the environment gives, None for nothing.
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

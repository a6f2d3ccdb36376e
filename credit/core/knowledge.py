"""What environments tell components that ask for it by name, so that no component is ever given the environment."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from torch import Tensor

from credit.core.component import Component
from credit.core.errors import Misfit


@dataclass(frozen=True)
class KnownTransitions:
    """P itself: for oracles of planners.

    Attributes:
        backup: values [..., S] → Σ P(s'|s, a) v(s') [..., S, A].
    """

    backup: Callable[[Tensor], Tensor]


def inform(parts: Iterable[tuple[str, Component]], knowledge: object, environment: str = "this environment") -> None:
    """Give every component that knows something the knowledge that it asks for; before it is started.

    Args:
        parts: where components stand, and they, as `parts_of` finds them.
        knowledge: what the environment gives, None for nothing. environment: what messages call it.

    Raises:
        Misfit: components know another environment.
    """
    given = "nothing" if knowledge is None else type(knowledge).__name__
    asking = [(path, part, part.knows) for path, part in parts if part.knows is not None]
    wrong = [
        (
            path,
            f"{type(part).__name__} needs {wanted.__name__}, and {environment} gives {given}: it is made for another "
            "environment; choose another component in its place, or the environment that it knows",
        )
        for path, part, wanted in asking
        if not isinstance(knowledge, wanted)
    ]
    if wrong:
        raise Misfit(wrong)
    for _, part, _ in asking:
        part.learn(knowledge)

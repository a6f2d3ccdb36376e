"""What an environment tells those that ask for it by name; nobody else, and never the environment itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from credit.core.capabilities import parts_of
from credit.core.component import Component
from credit.core.errors import UserError


def inform(roots: Mapping[str, Component], knowledge: Any) -> None:
    """Give every part that `knows` something what the environment tells.

    Raises:
        UserError: the environment tells something else, or nothing.
    """
    lines = []
    for name, root in roots.items():
        for path, part in parts_of(root, name):
            if part.knows is None:
                continue
            if isinstance(knowledge, part.knows):
                part.learn(knowledge)
                continue
            told = f"tells {type(knowledge).__name__}" if knowledge is not None else "tells nothing"
            lines.append(
                f"{path}: {type(part).__name__} is made for environments that tell {part.knows.__name__}, and this one "
                f"{told}; choose another one, or another env"
            )
    if lines:
        raise UserError("\n".join(lines))

"""The root of everything that YAML can name. Light to import: no torch."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from credit.core.state import Stateful

Kind = Literal["finite", "vector", "any"]  # of a space: numbers, vectors, or whatever it is
Setting = Literal["continuing", "episodic", "any"]


class Component(Stateful, ABC):
    """Anything that YAML can name.

    Attributes:
        observations, actions: the spaces it takes. setting: the tasks it takes.
        needs: slot → class: what must sit in another slot for this component to work.
        knows: the class of knowledge that an environment must give, where the component asks for it.
        sees_primitive: whether it is shown primitive rewards (only the oracle is).
    """

    observations: ClassVar[Kind] = "any"
    actions: ClassVar[Kind] = "any"
    setting: ClassVar[Setting] = "any"
    needs: ClassVar[Mapping[str, type]] = {}
    knows: ClassVar[type | None] = None
    sees_primitive: ClassVar[bool] = False

    def learn(self, knowledge: Any) -> None:
        """Take what the environment knows, an instance of `knows`; called before `start`, where `knows` is set."""

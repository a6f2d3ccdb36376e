"""The root of everything that YAML can name. Light to import: no torch."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import ClassVar, Literal

from credit.core.state import Stateful

Domain = Literal["tabular", "continuous", "any"]
Setting = Literal["continuing", "episodic", "any"]


class Component(Stateful, ABC):
    """Anything that YAML can name.

    Attributes:
        domain: the spaces it works on. setting: the tasks it works on; an environment has one of each.
        needs: slot → class: what must sit in another slot for this component to work.
        sees_primitive: whether it is shown primitive rewards (only the oracle is).
    """

    domain: ClassVar[Domain] = "any"
    setting: ClassVar[Setting] = "any"
    needs: ClassVar[Mapping[str, type]] = {}
    sees_primitive: ClassVar[bool] = False

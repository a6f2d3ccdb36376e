"""The root of everything that YAML can name. Light to import: no torch."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import ClassVar, Literal

Domain = Literal["tabular", "continuous", "any"]


class Component(ABC):  # noqa: B024 - its kinds say what is abstract
    """Anything that YAML can name.

    Attributes:
        domain: the environments it works on.
        needs: slot → class: what must sit in another slot for this component to work.
        sees_primitive: whether it is shown primitive rewards (only the oracle is).
    """

    domain: ClassVar[Domain] = "any"
    needs: ClassVar[Mapping[str, type]] = {}
    sees_primitive: ClassVar[bool] = False

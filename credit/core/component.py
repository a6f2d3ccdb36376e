"""The root of everything that YAML can name. Light to import: no torch."""

from __future__ import annotations

import inspect
from abc import ABC
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import wraps
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

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Constructors refuse what their signatures do not allow, whoever calls them."""
        super().__init_subclass__(**kwargs)
        if "__init__" in vars(cls):
            cls.__init__ = ranged(cls.__init__)  # type: ignore[method-assign]

    def learn(self, knowledge: Any) -> None:
        """Take what the environment knows, an instance of `knows`; called before `start`, where `knows` is set."""

    def remark(self) -> str:
        """What a user should know of it before a run, once started; nothing by default."""
        return ""


def ranged(constructor: Callable[..., None]) -> Callable[..., None]:
    """A constructor that refuses what its signature does not allow; the signature stays what it is."""
    shape = inspect.signature(constructor)

    @wraps(constructor)
    def made(self: Any, *args: Any, **kwargs: Any) -> None:
        from credit.core import signatures  # which knows components

        with suppress(TypeError):  # of arguments that do not fit at all: the constructor says so itself
            signatures.check(constructor, type(self).__name__, shape.bind(self, *args, **kwargs).arguments)
        constructor(self, *args, **kwargs)

    return made

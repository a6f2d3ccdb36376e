"""Classes that are lent to a configuration: it names a class by a path, and one that is being written may have none."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.signatures import REQUIRED, component_kind, signature
from credit.testing.short import FEW

_numbers = itertools.count()


@contextmanager
def lent(thing: type[Component] | Component) -> Iterator[dict[str, Any]]:
    """A node of a configuration that makes a component, as long as the context lasts.

    Args:
        thing: a class, made with its defaults and little work to do; or an instance, of which copies are made.

    Raises:
        UserError: a parameter of the class has no default.
    """
    cls = thing if isinstance(thing, type) else _of_copies(thing)
    missing = [name for name, (hint, default) in signature(cls).items() if default is REQUIRED and _plain(hint)]
    if missing:
        raise UserError(
            f"{cls.__name__}: no defaults for {', '.join(missing)}; check an instance, {cls.__name__}(...), or the "
            "option whose file gives them"
        )
    name = f"{cls.__name__}{next(_numbers)}"
    globals()[name] = cls
    try:
        little = {key: few for key, few in FEW.items() if key in signature(cls)}
        yield {"_target_": f"{__name__}.{name}"} | little
    finally:
        del globals()[name]


def _plain(hint: Any) -> bool:
    return component_kind(hint) is None


def _of_copies(part: Component) -> type[Component]:
    """A class without parameters that makes copies of a part."""
    methods = {"__new__": lambda cls: copy.deepcopy(part), "__init__": lambda self: None}
    return type(type(part).__name__, (type(part),), methods | {"__module__": type(part).__module__})

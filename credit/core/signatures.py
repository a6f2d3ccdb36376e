"""Constructor signatures: what a component's parameters are, which of them are components, and how to say it."""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from annotated_types import Predicate

from credit.core.component import Component
from credit.core.errors import UserError

REQUIRED = inspect.Parameter.empty


@cache
def signature(cls: type) -> dict[str, tuple[Any, Any]]:
    """Constructor parameters: name → (type hint, default or REQUIRED)."""
    constructor = inspect.getattr_static(cls, "__init__")
    if constructor is object.__init__:
        return {}
    hints = typing.get_type_hints(constructor, include_extras=True)
    parameters = inspect.signature(cls).parameters
    return {name: (hints.get(name, Any), parameter.default) for name, parameter in parameters.items()}


def component_kind(hint: Any) -> type[Component] | None:
    """The component class that a parameter wants: itself, `X | None`, or the values of a mapping."""
    if isinstance(hint, type) and issubclass(hint, Component):
        return hint
    return next(filter(None, map(component_kind, typing.get_args(hint))), None)


def takes_several(hint: Any) -> bool:
    """Whether a parameter wants components by name, `Mapping[str, X]`, or takes one instead of them."""
    origins = [typing.get_origin(part) for part in (hint, *typing.get_args(hint))]
    return any(isinstance(origin, type) and issubclass(origin, Mapping) for origin in origins)


def check(constructor: Callable[..., None], name: str, given: Mapping[str, Any]) -> None:
    """Refuse arguments that a signature does not allow: numbers out of range, words of no choice, no component.

    Args:
        constructor: whose signature. name: of the class. given: name → argument; what has no range, and is no
            component, is not looked at.

    Raises:
        UserError: with class, name and value, and what is allowed.
    """
    for key, hint in _ranged(constructor).items():
        if key in given:
            value = given[key]
            if (kind := component_kind(hint)) is not None:
                if isinstance(value, str | bytes | int | float):  # by its name, as in YAML
                    wanted = f"an instance of credit.core.seams.{kind.__name__}"
                    raise UserError(f"{name}({key}={value!r}): {value!r} is no component; give {wanted}")
                continue
            if reason := refusal(hint, value.item() if getattr(value, "ndim", None) == 0 else value):
                raise UserError(f"{name}({key}={value!r}): {reason}")


def refusal(hint: Any, value: Any) -> str | None:
    """Why a value is none of those that a hint allows, and which are; None where it is one."""
    from pydantic import ValidationError

    try:
        adapter(hint).validate_python(value)
    except ValidationError as error:
        reason = error.errors()[0]
        said = "it is not allowed" if reason["type"] == "predicate_failed" else reason["msg"]
        whole = f"; write {value:.0f}" if reason["type"] == "int_type" and _is_whole(value) else ""
        return f"{said}; allowed: {describe(hint)}{whole}"
    return None


def _is_whole(value: Any) -> bool:
    return isinstance(value, float) and value.is_integer()  # 1e4


@cache
def adapter(hint: Any) -> Any:
    """What validates a value by its hint, strictly: no text is a number, and no number is infinite."""
    from pydantic import ConfigDict, TypeAdapter

    return TypeAdapter(hint, config=ConfigDict(strict=True, allow_inf_nan=False))


@cache
def _ranged(constructor: Callable[..., None]) -> dict[str, Any]:
    """Parameters with a range or a choice, and components: name → hint; none where hints cannot be read."""
    try:
        hints = typing.get_type_hints(constructor, include_extras=True)
    except NameError:  # of a name that is there for type checkers alone
        return {}
    hints.pop("return", None)
    return {name: hint for name, hint in hints.items() if _limited(hint) or component_kind(hint) is not None}


def _limited(hint: Any) -> bool:
    inner = typing.get_args(hint)
    return typing.get_origin(hint) in (typing.Annotated, typing.Literal) or any(map(_limited, inner))


def describe(hint: Any) -> str:
    """A type hint as a user would say it: `float > 0`, `one of random, lexicographic`."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return " ".join([describe(inner[0]), *_limits(inner[1:])])
    if origin is typing.Literal:
        return "one of " + ", ".join(str(value) for value in inner)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(describe(part) for part in inner)
    if origin is dict:
        return f"a mapping: {describe(inner[0])} → {describe(inner[1])}"
    if origin is not None and inner:
        return f"list of {part}" if " or " not in (part := describe(inner[0])) else f"list of ({part})"
    return "null" if hint is type(None) else str(getattr(hint, "__name__", hint))


def _limits(limits: tuple[Any, ...]) -> list[str]:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = [
        f"{sign} {getattr(limit, name)}"
        for limit in limits
        for name, sign in signs.items()
        if getattr(limit, name, None) is not None
    ]
    said = [f"({(limit.func.__doc__ or '').rstrip('.')})" for limit in limits if isinstance(limit, Predicate)]
    return [" and ".join(found), *said] if found else said

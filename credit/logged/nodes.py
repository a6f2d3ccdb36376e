"""Registered parts as plain values, from which they are made again: classes by registered names, and parameters.

A folder can name nothing but what YAML files of credit and of announced packages name, and so runs nothing else.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from credit.core.component import Component
from credit.core.errors import UserError, nearest
from credit.core.signatures import component_kind, signature
from credit.renamed import today

TARGET = "_target_"
KINDS = ("reward", "features", "uncertainty", "network")  # of which a reward model is made
BY_NAME = ("credit.networks.modules.Module",)  # what imports whatever it is told to


@cache
def targets() -> frozenset[str]:
    """All that may be made again."""
    from credit.config.classes import registered

    return registered(KINDS) - {*BY_NAME}


def described(part: Component, node: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A part as plain values, with the parts that it holds.

    Args:
        part: not started, or started. node: the configuration that it was made of, where it is known.

    Raises:
        UserError: it could not be made again of them.
    """
    cls, node = type(part), node or {}
    target = f"{cls.__module__}.{cls.__qualname__}"
    if target not in targets():
        raise UserError(
            f"{cls.__name__} is not saved: no YAML file of credit or of a package that announced itself names {target}"
        )
    found: dict[str, Any] = {TARGET: target}
    for name, (hint, _) in signature(cls).items():
        given = node.get(name)
        if component_kind(hint) is None:
            if name in node:
                found[name] = _plain(cls, name, given)
            elif not node:
                found[name] = _plain(cls, name, vars(part).get(name, part))
        elif (held := vars(part).get(name, part)) is not part:
            found[name] = _parts(cls, name, held, given if isinstance(given, Mapping) else {})
        elif name in node or not node:
            _plain(cls, name, part)
    return found


def _parts(cls: type, name: str, held: Any, node: Mapping[str, Any]) -> Any:
    """What a parameter holds: nothing, a part, or several by name."""
    if held is None:
        return None
    if isinstance(held, Component):
        return described(held, node)
    if isinstance(held, Mapping) and all(isinstance(one, Component) for one in held.values()):
        return {str(key): described(one, node.get(key)) for key, one in held.items()}
    return _plain(cls, name, cls)


def _plain(cls: type, name: str, value: Any) -> Any:
    """A value that JSON knows.

    Raises:
        UserError: it does not.
    """
    try:
        text = json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        text = ""
    found = json.loads(text) if text else None
    if not text or _lists(value) != found:
        raise UserError(f"{cls.__name__} is not saved: it does not keep its parameter {name!r} as a plain attribute")
    return found


def _lists(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _lists(each) for key, each in value.items()}
    return [_lists(each) for each in value] if isinstance(value, list | tuple) else value


def made(node: Any, kind: type[Component], where: str) -> Any:
    """A part that was described.

    Args:
        node: plain values. kind: the class that it must have. where: it stands, for messages.

    Raises:
        UserError: it names what is not registered, or of another kind, or parameters that are not allowed.
    """
    target = today(str(node[TARGET])) if isinstance(node, Mapping) and isinstance(node.get(TARGET), str) else ""
    if target not in targets():
        raise UserError(
            f"{where}: {target or node!r} is no registered part of a reward model (`credit list`), and a folder may "
            "name no other; install the package that has it, or recover anew"
        )
    module, _, name = target.rpartition(".")
    cls: Any = getattr(importlib.import_module(module), name)
    if not (isinstance(cls, type) and issubclass(cls, kind)):
        raise UserError(f"{where}: {target} is no {kind.__name__}; recover anew")
    hints, arguments = signature(cls), {}
    for key, value in node.items():
        if key == TARGET:
            continue
        if key not in hints:
            raise UserError(f"{where}.{key}: {cls.__name__} has no such parameter; {nearest(key, hints)}")
        inner = component_kind(hints[key][0])
        arguments[key] = value if inner is None or value is None else _held(value, inner, f"{where}.{key}")
    return cls(**arguments)


def _held(value: Any, kind: type[Component], where: str) -> Any:
    if isinstance(value, Mapping) and TARGET not in value:
        return {key: made(one, kind, f"{where}.{key}") for key, one in value.items()}
    return made(value, kind, where)

"""Which class an option or a node means, and what it takes."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from credit.config import files
from credit.core import source
from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.signatures import signature
from credit.renamed import today

ENTRY_POINTS = "credit.components"


def resolve(path: str, node: Mapping[str, Any]) -> type[Component]:
    """The class behind `_target_`, if it is one that may be built.

    Raises:
        UserError: not importable, not a component, or of a package that did not announce itself.
    """
    target = str(node["_target_"])
    module, _, name = target.rpartition(".")
    if module.split(".")[0] not in allowed_packages():
        raise UserError(
            f"{path}._target_={target!r}: only classes of these packages may be built: "
            f"{', '.join(sorted(allowed_packages()))}; a package announces itself by an entry point {ENTRY_POINTS!r}"
        )
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        if (now := today(target)) != target:
            raise UserError(f"{path}._target_={target!r} has another name now: {now}") from None
        raise UserError(f"{path}._target_={target!r} cannot be imported: {error}") from None
    except Exception as error:  # whatever somebody's own module may raise
        raise UserError(
            f"{path}._target_={target!r} cannot be imported: {module} raised {type(error).__name__}: {error}"
        ) from error
    if not (isinstance(found, type) and issubclass(found, Component)):
        raise UserError(f"{path}._target_={target!r} is not a component of credit")
    return found


def parameters(path: str, node: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """What the class behind `_target_` takes, as `signature` says it; without importing it, where its source tells.

    Raises:
        UserError: as `resolve`.
    """
    read = source.signature(str(node["_target_"]))
    return signature(resolve(path, node)) if read is None else read


def of_option(kind: str, name: str, config_dirs: Sequence[str] = ()) -> type[Component] | None:
    """The class of an option, as its file says it or the one that it starts from; None where they do not say it."""
    node = node_of_option(kind, name, config_dirs)
    with suppress(UserError):
        return resolve(f"{kind}={name}", node) if is_component(node) else None
    return None


def node_of_option(kind: str, name: str, config_dirs: Sequence[str] = ()) -> dict[str, Any]:
    """The keys of an option's file and of those that it starts from; empty where they cannot be told."""
    options, found = files.options(kind, config_dirs), dict[str, Any]()
    with suppress(UserError, LookupError, ValueError):
        for _ in options:  # no chain is longer
            node = files.read(options[name])
            found = {key: value for key, value in node.items() if key != "defaults"} | found
            if is_component(node):
                return found
            *_, name = files.bases(kind, node)
    return {}


def names(kind: str) -> list[str]:
    """Of the options of a kind, of credit and of packages that announced themselves."""
    return [*files.options(kind)]


def registered(kinds: Sequence[str]) -> frozenset[str]:
    """The `_target_` of every option of some kinds, of credit and of packages that announced themselves."""
    nodes = [node_of_option(kind, name) for kind in kinds for name in files.options(kind)]
    return frozenset(str(node["_target_"]) for node in nodes if is_component(node))


@cache
def allowed_packages() -> frozenset[str]:
    """`credit`, and every package with an entry point in the group `credit.components`."""
    return frozenset({"credit", *(point.module.split(".")[0] for point in entry_points(group=ENTRY_POINTS))})


def is_component(value: Any) -> bool:
    """Whether a node describes a component."""
    return isinstance(value, Mapping) and "_target_" in value

"""Is a configuration right, and what does it build? Schemas come from signatures; nothing is declared twice.

A *slot* is a top-level key that holds one component (`mixer`) or several by name (`bonus`). A constructor asks for
another component by naming its slot: `RewardRecovery(mixer: Mixer, ...)` gets the one in `mixer`; one that it can do
without it gets where it is of the kind that it takes. The trainer is the root; what it does not reach is not built.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from credit.config.classes import is_component, node_of_option, of_option, resolve
from credit.config.kinds import SLOTS
from credit.core.component import Component
from credit.core.errors import UserError, nearest
from credit.core.naming import is_name
from credit.core.signatures import REQUIRED, component_kind, describe, refusal, signature, takes_several
from credit.renamed import instead


class Check:
    """Find every problem of a composed configuration at once; build nothing.

    Args:
        config: plain mappings and lists; components are mappings with `_target_`.
        slots: slot → the class that its components must have.
        job: a dataclass whose fields are the plain keys of the top level.
        roots: the slots that are built; what they ask for is built too.

    Attributes:
        problems: one sentence each. remark: what is right, but a user should know. used: slots that the roots reach.
    """

    def __init__(
        self,
        config: Mapping[str, Any],
        slots: Mapping[str, type[Component]],
        job: type,
        roots: tuple[str, ...],
    ) -> None:
        self.problems: list[str] = []
        self.remark = ""
        self.used: set[str] = set()
        self._config = config
        self._slots, self._roots = slots, roots
        self._classes: dict[str, dict[str, type[Component]]] = {}  # slot → path → class, without nested parts
        self._parts: dict[str, list[tuple[str, type[Component]]]] = {}  # slot → nested parts
        self._left: dict[str, list[tuple[str, type[Component], Any]]] = {}  # slot → who keeps a default instead of it
        plain = {key: value for key, value in config.items() if key not in slots}
        self._arguments("", plain, job, extra_names=slots)
        for slot, kind in slots.items():
            self._classes[slot], self._parts[slot] = {}, []
            for path, node in self._named(slot).items():
                cls = self._component(slot, path, node, kind)
                if cls is not None:
                    self._classes[slot][path] = cls
        for slot in roots:
            self._reach(slot, "the run")
        for slot, askers in self._left.items():
            if slot not in self.used:  # what everybody leaves out was chosen in vain
                for path, cls, hint in askers:
                    self._suits(path, cls, slot, hint)
        if not self.problems:
            self._fit()

    def _named(self, slot: str, config: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The members of a slot whose names are names."""
        found = members(self._config if config is None else config, slot)
        bad = [path for path in found if path != slot and not _is_key(path.removeprefix(f"{slot}."))]
        self.problems += [f"{path!r}: {path.removeprefix(f'{slot}.')!r} is no name; {KEYS}" for path in bad]
        return {path: node for path, node in found.items() if path not in bad}

    def _component(self, slot: str, path: str, node: Any, kind: type[Component]) -> type[Component] | None:
        if not is_component(node):
            self.problems.append(f"{path}={node!r}: a component belongs here; choose one (see `credit list`)")
            return None
        try:
            cls = resolve(path, node)
        except UserError as error:
            self.problems.append(str(error))
            return None
        if not issubclass(cls, kind):
            self.problems.append(f"{path}: {cls.__name__} is not a {kind.__name__}")
            return None
        values = {key: value for key, value in node.items() if key != "_target_"}
        self._arguments(f"{path}.", values, cls, slot=slot)
        return cls

    def _arguments(
        self,
        prefix: str,
        values: Mapping[str, Any],
        cls: type,
        slot: str = "",
        extra_names: Mapping[str, Any] = {},
    ) -> None:
        hints = signature(cls)
        for key, value in values.items():
            path = f"{prefix}{key}"
            if key not in hints:
                if answers := _gone(path, value):
                    self.problems += answers
                    continue
                if is_component(value) and prefix == f"{slot}.":
                    self.problems.append(
                        f"{path}: {slot} is one {cls.__name__} already, and several need a name each; its file begins "
                        f"with the line `# @package {slot}.NAME`"
                    )
                    continue
                shown = "" if isinstance(value, Mapping) else f" (value {value!r})"
                self.problems.append(f"{path}: unknown key{shown}; {nearest(key, [*hints, *extra_names])}")
                continue
            hint, _ = hints[key]
            kind = component_kind(hint)
            if value == "???":
                self.problems.append(f"{path}: a value is missing; give {path}=<{describe(hint)}>")
            elif kind is None:
                self._value(path, value, hint)
            elif value is None and type(None) not in typing.get_args(hint):
                self.problems.append(f"{path}=null: a {kind.__name__} belongs here (a mapping with _target_)")
            elif not (takes_several(hint) or value is None or is_component(value)):
                self.problems.append(f"{path}={value!r}: one {kind.__name__} belongs here (a mapping with _target_)")
            else:
                for inner, node in self._named(path, {path: value}).items():
                    if (part := self._component(slot, inner, node, kind)) is not None:
                        self._parts[slot].append((inner, part))
        for name, (hint, default) in hints.items():
            if name not in values and default is REQUIRED and component_kind(hint) is None:
                path = f"{prefix}{name}"
                self.problems.append(f"{path}: a value is missing; give {path}=<{describe(hint)}>")

    def _value(self, path: str, value: Any, hint: Any) -> None:
        if reason := refusal(hint, value):
            self.problems.append(f"{path}={value!r}: {reason}")

    def _reach(self, slot: str, asker: str) -> None:
        """Mark a slot and all that it asks for as used; complain about what is asked for and not there."""
        if slot in self.used:
            return
        self.used.add(slot)
        for path, cls in [*self._classes[slot].items(), *self._parts[slot]]:
            node = at(self._config, path)
            for name, (hint, default) in signature(cls).items():
                if name in node or component_kind(hint) is None:
                    continue
                if name == "env" and slot not in self._roots:
                    self.problems.append(
                        f"{path}: {cls.__name__} asks for env, and the environment knows the true reward; ask for what "
                        "it tells learners: knows = <the class of its knowledge()>"
                    )
                    continue
                if name not in self._slots:
                    if default is REQUIRED:
                        self.problems.append(f"{path}.{name}: a component is missing here (a mapping with _target_)")
                elif leaves_out(self._config.get(name), hint, default):
                    self._left.setdefault(name, []).append((path, cls, hint))
                elif takes_several(hint) or is_component(self._config.get(name)):
                    self._reach(name, path)
                    self._suits(path, cls, name, hint)
                elif isinstance(self._config.get(name), Mapping):
                    self.problems.append(f"{name}: {path} needs one component here, not several by name")
                elif default is REQUIRED and self._config.get(name) is None:
                    word = name if SLOTS.get(name, name) == name else f"{SLOTS[name]}@{name}"
                    self.problems.append(f"{name}: {path} needs one, and there is none; add {word}=<option> ({asker})")

    def _suits(self, path: str, cls: type[Component], slot: str, hint: Any) -> None:
        """Complain about components in a slot that are not of the class that a constructor asks for."""
        wanted = component_kind(hint)
        assert wanted is not None
        for other, given in self._classes[slot].items():
            if not issubclass(given, wanted):
                self.problems.append(
                    f"{path}: {cls.__name__} needs a {wanted.__name__} in {other}, and there is {given.__name__}; "
                    f"choose another {slot}, or give {path}.{slot} one of its own"
                )

    def _fit(self) -> None:
        """Do the parts fit together: what each declares that it needs in other slots."""
        for slot in sorted(self.used):
            for path, cls in [*self._classes[slot].items(), *self._parts[slot]]:
                for needed_slot, needed in cls.needs.items():
                    for other, other_class in self._classes.get(needed_slot, {}).items():
                        if not issubclass(other_class, needed):
                            self.problems.append(
                                f"{path}: {cls.__name__} needs a {needed.__name__} in {other}, and there is "
                                f"{other_class.__name__}; choose another {slot}, or another {needed_slot}"
                            )


KEYS = "allowed are letters, digits, _ and -, beginning with a letter"


def _is_key(name: str) -> bool:
    return "." not in name and " " not in name and "+" not in name and is_name(name)


def _gone(path: str, value: Any) -> list[str]:
    """What to write for a key of an older version, or for each key in it."""
    paths = [f"{path}.{key}" for key in value] if isinstance(value, Mapping) else []
    return [f"{old}: this is gone; {now}" for old in paths or [path] if (now := instead(old) or instead(path))]


def build(config: Mapping[str, Any], slot: str) -> Any:
    """Build a slot's component and everything it asks for; what two components ask for is built once.

    Raises:
        UserError: a constructor refused its arguments.
    """
    made: dict[str, Any] = {}

    def from_slot(name: str) -> Any:
        if name not in made:
            parts = {path.rpartition(".")[2]: from_node(node) for path, node in members(config, name).items()}
            made[name] = parts[name] if is_component(config.get(name)) else parts
        return made[name]

    def from_value(value: Any, kind: type | None) -> Any:
        if kind is None or value is None:
            return value
        return from_node(value) if is_component(value) else {key: from_node(node) for key, node in value.items()}

    def from_node(node: Mapping[str, Any]) -> Any:
        """One component."""
        target = str(node["_target_"])
        cls, arguments = resolve(target, node), {}
        for name, (hint, default) in signature(cls).items():
            if name in node:
                arguments[name] = from_value(node[name], component_kind(hint))
            elif leaves_out(config.get(name), hint, default):
                continue
            elif component_kind(hint) is not None and (config.get(name) or default is REQUIRED):
                held = from_slot(name)
                alone = takes_several(hint) and is_component(config.get(name))
                arguments[name] = {name: held} if alone else held  # where several are wanted, one is a group of one
        try:
            return cls(**arguments)
        except UserError:
            raise
        except Exception as error:  # whatever somebody's own constructor may raise
            raise UserError(f"{target}: it cannot be made ({type(error).__name__}: {error})") from error

    return from_slot(slot)


def leaves_out(node: Any, hint: Any, default: Any) -> bool:
    """Whether a parameter keeps its default, since what is in the slot of its name is not of the kind that it takes."""
    wanted = component_kind(hint)
    if default is REQUIRED or wanted is None or not is_component(node):
        return False
    with suppress(UserError):
        return not issubclass(resolve("", node), wanted)
    return False


def made_option(kind: str, name: str, config_dirs: Sequence[str] = ()) -> type[Component] | Component | None:
    """What an option makes by itself; its class, where it needs others for that."""
    cls = of_option(kind, name, config_dirs)
    with suppress(UserError):
        made: Component = build({kind: node_of_option(kind, name, config_dirs)}, kind)
        return made
    return cls


def members(config: Mapping[str, Any], slot: str) -> dict[str, Any]:
    """Path → node of a slot: one entry for a component, one a name for a group, none where the slot is empty."""
    value = config.get(slot)
    if value is None:
        return {}
    if is_component(value) or not isinstance(value, Mapping):
        return {slot: value}
    return {f"{slot}.{name}": node for name, node in value.items()}


def at(config: Mapping[str, Any], path: str) -> Any:
    """The node at a dotted path."""
    node: Any = config
    for key in path.split("."):
        node = node[key]
    return node

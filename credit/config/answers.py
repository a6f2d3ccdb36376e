"""What Hydra's errors mean for the user: which word was wrong, and the nearest name that exists."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from credit.config import classes, files
from credit.config.kinds import CHOICES, KINDS
from credit.core.errors import UnknownKey, UserError, nearest
from credit.renamed import instead

Compose = Callable[[Sequence[str], Sequence[str]], dict[str, Any]]


def explain(error: Exception, overrides: Sequence[str], config_dirs: Sequence[str], compose: Compose) -> str:
    """What Hydra's error means for the user.

    Args:
        error: of Hydra or OmegaConf, or a RecursionError. overrides, config_dirs: as they were given.
        compose: `registry.compose`.

    Raises:
        UnknownKey: that is what it means.
    """
    if isinstance(error, RecursionError):
        paths = [path for kind in (*KINDS, *CHOICES) for path in files.circular(kind, config_dirs)]
        if not paths:
            return f"{' '.join(overrides)}: no key that these words need is there; take the last ones out one by one"
        return f"{', '.join(map(str, paths))}: starts from itself; take that out of its defaults list"
    if isinstance(error, UnicodeDecodeError):
        return "\n".join(files.undecodable(config_dirs)) or str(error)
    message = str(error)
    written = re.findall(r"(?:Interpolation key|Could not override) '([\w.]+)'", message)
    if old := next((text for text in (*overrides, *written) if instead(text)), None):
        return f"{old}: this is gone; {instead(old)}"
    if found := re.search(r"Could not (?:load|find) '((?:hydra/)?[\w@.]+)/([^']*)'", message):
        group, option = found[1].partition("@")[0], found[2]
        return no_option(group, option, config_dirs)
    found = re.search(r"Could not delete '([\w@./]+)'", message)
    if found and found[1] in KINDS and KINDS[group := found[1]].several:
        return f"'~{group}': {group} is a list of options; {group}=[] is none of them, {group}=[<option>] another"
    if found := re.search(r"Could not (?:override|delete)[^']*'([\w@./]+)'", message):
        raise UnknownKey(_unknown_key(found[1], list(overrides), config_dirs, compose)) from None
    if message.startswith("Config group override must be"):
        for text in overrides:
            group, _, value = text.lstrip("+~").partition("=")
            named = value.strip("[] ").isidentifier() and value != "null"
            if (kind := group.partition("@")[0]) in {*KINDS, *CHOICES, ""} and not named:
                known = ", ".join(files.options(kind, config_dirs)) if kind else ", ".join([*KINDS, *CHOICES])
                return f"{text!r}: no name of an option; valid: {known}"
    return re.sub(r"\s*\n\s*", "; ", message.strip())


def no_option(group: str, option: str, config_dirs: Sequence[str]) -> str:
    """What to say of an option that a group lacks: what it is elsewhere, or else the nearest one."""
    known = files.options(group, config_dirs)
    for other in (*KINDS, *CHOICES):
        if option not in known and option in files.options(other, config_dirs):
            return f"{group}={option}: no such option; {option} is an option of {other}, write {other}={option}"
    return f"{group}={option}: no such option; {nearest(option, known)}"


def of_constructor(
    error: Exception, overrides: Sequence[str], config_dirs: Sequence[str], compose: Compose
) -> list[str] | None:
    """The words with a `+` before a key that no file says, but a constructor has; None where that is not the trouble.

    To Hydra it is a new key, to a user it is one of those that `credit check --explain` lists.
    """
    found = re.search(r"Could not override '([\w.]+)'", str(error))
    if not found:
        return None
    path = found[1].rpartition(".")[0]
    keys = {text: text.partition("=")[0].removeprefix(f"{path}.") for text in overrides if text.startswith(f"{path}.")}
    if not keys:
        return None
    node: Any = compose([text for text in overrides if text not in keys], config_dirs)
    for part in path.split("."):
        node = node.get(part) if isinstance(node, dict) else None
    if not classes.is_component(node):
        return None
    new = classes.parameters(path, node).keys() - node.keys()  # all at once: composing takes the time
    words = {text for text, key in keys.items() if key in new}
    return [f"+{text}" if text in words else text for text in overrides] if words else None


def _unknown_key(key: str, overrides: list[str], config_dirs: Sequence[str], compose: Compose) -> str:
    """Name the deepest part of a key that exists, and the keys that could follow it, in a file or a constructor."""
    others = [text for text in overrides if text.lstrip("+~").partition("=")[0] != key]
    written = next((text for text in overrides if text not in others), key)
    if (kind := key.partition("@")[0]) in KINDS and kind not in KINDS[kind].slots:
        return f"{written!r}: behind {kind}@ stands where it goes, and nothing is there; {KINDS[kind].help}"
    node: Any = compose(others, config_dirs)
    parents: list[str] = []
    for part in key.split("."):
        if not isinstance(node, dict) or part not in node:
            break
        node = node[part]
        parents.append(part)
    valid = [name for name in node if name != "_target_"] if isinstance(node, dict) else []
    if classes.is_component(node):
        with suppress(UserError):  # of a class that cannot be had, only what its file says
            valid += classes.parameters(".".join(parents), node)
    if not parents:
        valid += [*KINDS, *CHOICES]
    path = ".".join([*parents, part])
    where = f" of {node['_target_'].rpartition('.')[2]}" if isinstance(node, dict) and "_target_" in node else ""
    return f"{path}: unknown key{where} (in {written!r}); {nearest(part, valid)}"

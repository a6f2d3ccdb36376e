"""The name of a run's folder: what differs from the method on this experiment, in one spelling, whatever was typed."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from credit.config import registry
from credit.config.identity import plain
from credit.config.kinds import CIRCUMSTANCES, KINDS
from credit.core.errors import UserError

NAMES = ("experiment", "method", "title")  # of folders above, or of nothing but tables
LONGEST = 120


def slug(config: Mapping[str, Any], overrides: Sequence[str], config_dirs: Sequence[str] = ()) -> str:
    """The words that would make this run of its experiment and method: `default` where these are enough.

    A group that was chosen is a word if it changes anything that the run uses, and a key if it differs from what the
    experiment, the method and these groups say. So `mixer.alpha=.5`, the same by an experiment's default, and nothing
    are one folder; and so is what only a user's own file says.

    Args:
        config: composed and checked, without what the run does not use.
        overrides, config_dirs: what it was composed of.

    Example:
        >>> slug(config, ["feedback=terminal", "seed=3", "mixer.alpha=.3"])
        'feedback=terminal,mixer.alpha=0.3'
    """
    words = registry.with_experiment(overrides, config_dirs)
    naming = {"experiment", "method"}
    if (registry.chosen("experiment", words) or "").startswith(registry.GENERIC):  # whose environment is in its name
        naming |= {"env", "env.id", "env.target"}
    known = [word for word in words if _group(word) in naming]
    kept = list(dict.fromkeys(word for word in words if _group(word) in {*KINDS} - naming - {"tracking"}))
    base = _base([*known, *kept], config, config_dirs)
    for word in list(kept):
        fewer = [other for other in kept if other != word]
        with suppress(UserError):  # a key that only this option has may be needed by another word
            if _same(without := _base([*known, *fewer], config, config_dirs), base):
                kept, base = fewer, without
    parts = [*map(_spelled, kept), *_differences(base, _shown(config))]
    whole = re.sub(r"[\[\]'\"]", "", ",".join(sorted(parts)))
    name = re.sub(r"[^A-Za-z0-9=._,@~+-]+", "-", whole).strip("-")
    if name != whole or len(name) > LONGEST:  # another one may look the same
        name = f"{name[: LONGEST - 10]}-{zlib.crc32(whole.encode()):08x}"
    return name or "default"


def _group(word: str) -> str:
    """The group whose option a word chooses, or its key."""
    return str(registry.parse(word).key_or_group)


def _base(words: Sequence[str], config: Mapping[str, Any], config_dirs: Sequence[str]) -> dict[str, Any]:
    """What words alone compose, of what the run uses; without the user's folders where nothing of theirs is named."""
    try:
        found = registry.compose(words)
    except UserError:
        found = registry.compose(words, config_dirs)
    return {key: value for key, value in _shown(found).items() if key in config}


def _shown(config: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in config.items() if key not in {*NAMES, *CIRCUMSTANCES}}


def _spelled(word: str) -> str:
    """A group's word as it would be typed."""
    parsed = registry.parse(word)
    if parsed.is_delete():
        return f"~{parsed.key_or_group}"
    package = f"@{parsed.package}" if parsed.package else ""
    return f"{parsed.key_or_group}{package}={parsed.get_value_element_as_str()}"


def _differences(base: Any, now: Any, path: str = "") -> Iterator[str]:
    """A word for every key that differs."""
    if not (isinstance(base, Mapping) and isinstance(now, Mapping)):
        if not _same(base, now):
            yield f"{path}={_value(now, base)}"
        return
    for key in base.keys() | now.keys():
        inner = f"{path}.{key}" if path else str(key)
        if key not in now:
            yield f"~{inner}"
        elif key in base or not isinstance(now[key], Mapping):
            yield from _differences(base.get(key, _NOTHING), now[key], inner)
        else:
            yield from _differences({}, now[key], inner)


_NOTHING = object()


def _same(one: Any, other: Any) -> bool:
    """Whether two values are one: 1 and 1.0 are."""
    return _text(one) == _text(other)


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        value = {str(key): _text(inner) for key, inner in value.items()}
    return json.dumps(plain(value), sort_keys=True, default=repr)


def _value(value: Any, base: Any) -> str:
    """A value as one would type it; a number in the way of the one that it replaces."""
    if isinstance(base, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"), ensure_ascii=False)

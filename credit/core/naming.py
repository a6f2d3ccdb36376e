"""Names: which may reach files, columns, metrics and the terminal, how they leave, and that of a registered class."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

LONGEST = 100  # bytes of a name: folders and metrics put words of their own before and behind it
LONGEST_METRIC = 250  # letters, of MLflow


def is_name(text: str) -> bool:
    """letters, digits, _ - . + and single blanks within, the first a letter or digit, 100 bytes at most."""
    return re.fullmatch(r"[^\W_](?:[\w.+-]| (?! |$))*", text) is not None and len(text.encode()) <= LONGEST


def is_line(text: str) -> bool:
    """one line without control characters, 1 to 200 letters."""
    return text.isprintable() and bool(text.strip()) and len(text) <= 2 * LONGEST


def is_metric(text: str) -> bool:
    """names with slashes between them (eval/return)."""
    return all(map(is_name, text.split("/")))


def metric_name(name: str) -> str:
    """What MLflow, which takes names for paths and knows few signs, calls a metric or a parameter.

    Example:
        >>> metric_name("weight/dnn"), metric_name("slug=a"), metric_name("../a")
        ('weight/dnn', 'slug_a', '_/a-3d4e4b0d')
    """
    known = re.sub(r"[^\w\-. :/]", "_", name)
    path = "/".join(part if part.strip(". ") else "_" for part in known.split("/"))
    if path == known and len(path) <= LONGEST_METRIC:
        return path
    return f"{path[: LONGEST_METRIC - 9]}-{zlib.crc32(name.encode()):08x}"  # another one may look the same


def registered_name(module: str, name: str) -> str:
    """The one name of a class within its kind, wherever it is defined; `package:name` for other packages.

    Args:
        module: in which it is; of it, the package counts. name: of the class.

    Example:
        >>> registered_name("credit.recovery.bonuses", "LocalMSE"), registered_name("shop.rules", "HTTPOutcome")
        ('local_mse', 'shop:http_outcome')
    """
    package = module.partition(".")[0]
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
    return name if package == "credit" else f"{package}:{name}"


def flat(key: str, node: Any) -> Iterator[tuple[str, Any]]:
    """A configuration as pairs of key and value; a component's own key has its registered name.

    Args:
        key: of the node; "" for a whole configuration. node: a mapping, or a value.

    Example:
        >>> dict(flat("mixer", {"_target_": "credit.recovery.mixers.RelativeMSE", "alpha": 0.5}))
        {'mixer': 'relative_mse', 'mixer.alpha': 0.5}
    """
    if not isinstance(node, Mapping):
        yield key, node
        return
    if "_target_" in node:
        module, _, name = str(node["_target_"]).rpartition(".")  # which may move
        yield key, registered_name(module, name).replace(":", ".")  # a name of files, too
    for name, inner in node.items():
        if name != "_target_":
            yield from flat(f"{key}.{name}" if key else str(name), inner)


def short_keys(keys: Iterable[str]) -> dict[str, str]:
    """Each key without the words at its front that no other one needs to be told apart.

    Example:
        >>> short_keys(["bonus.count.scale", "bonus.disagreement.scale", "mixer.alpha"])["mixer.alpha"]
        'alpha'
    """
    every = sorted({*keys})
    ends = {key: [".".join(key.split(".")[-count:]) for count in range(1, key.count(".") + 2)] for key in every}
    return {
        key: next(end for end in ends[key] if end == key or not any(end in ends[k] for k in every if k != key))
        for key in every
    }

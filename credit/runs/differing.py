"""What tells the jobs of one command apart, in as few words as will do: for tables and trackers, never for identity."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from credit.config.kinds import CIRCUMSTANCES
from credit.core.naming import flat, short_keys

_TITLE = "title"  # of tables: the method says it, too
_SAMPLE = ("seed", "replicas")  # these are circumstances of a run, but tell jobs apart
_ZERO = re.compile(r"(?<![\d.])0(?=\.\d)")  # before a point, where .3 says as much

Label = dict[str, Any]


def parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Key → value of all that a run is: components by their registered names, no circumstances, nothing that is off.

    Example:
        >>> parameters({"method": "delayed", "output": "outputs", "policy_from": None})
        {'method': 'delayed'}
    """
    kept = {key: node for key, node in config.items() if key not in (*CIRCUMSTANCES, _TITLE)}
    return {key: value for key, value in flat("", kept) if "." in key or value not in (None, [])}


def chosen(overrides: Iterable[str]) -> list[str]:
    """The words that say what a run is beside its experiment and method, without circumstances.

    Example:
        >>> chosen(["method=delayed", "agent.updates=2", "replicas=2", "feedback=terminal"])
        ['agent.updates=2', 'feedback=terminal']
    """
    others = {*CIRCUMSTANCES, _TITLE, "experiment", "method"}
    return [word for word in overrides if re.split(r"[.@=]", word.lstrip("+~"), maxsplit=1)[0] not in others]


def labels(configs: Sequence[Mapping[str, Any]]) -> list[Label]:
    """For each job, what tells it from the others: what jobs of its experiment and method differ in, then these.

    Args:
        configs: of all jobs, checked.

    Returns:
        Key → value, one a job; empty where there is one job alone.
    """
    every = [parameters(config) | {key: config.get(key) for key in _SAMPLE} for config in configs]
    names = [key for key in ("experiment", "method") if _differs(key, every)]
    kinds = [tuple(one.get(key) for key in ("experiment", "method")) for one in every]
    found = []
    for one, kind in zip(every, kinds, strict=True):
        alike = [other for other, its in zip(every, kinds, strict=True) if its == kind]
        own = [key for key in one if key not in names and _differs(key, alike)]
        found.append({key: one[key] for key in (*own, *names)})
    return found


def name(label: Label, others: Iterable[Label]) -> str:
    """A label in a line, for lists that show its first letters: what was varied as short as can be, then the names.

    Args:
        label: of one job. others: of all jobs, itself included.

    Example:
        >>> name({"mixer.alpha": 0.3, "method": "reference"}, [{"mixer.alpha": 0.3, "method": "reference"}])
        'alpha=.3 reference'
    """
    short = short_keys(key for other in others for key in other)
    words = [
        str(value) if key in ("experiment", "method") else f"{short[key]}={re.sub(_ZERO, '', typed(value))}"
        for key, value in label.items()
    ]
    return " ".join(words)


def typed(value: Any) -> str:
    """A value as one would type it."""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"), ensure_ascii=False)


def _differs(key: str, every: Iterable[Mapping[str, Any]]) -> bool:
    return len({typed(one[key]) if key in one else None for one in every}) > 1

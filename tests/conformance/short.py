"""Short runs of whatever is registered: the configurations that the conformance tests share."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from credit.config import files, kinds, registry, schema
from credit.core.errors import UserError
from credit.runs import job

SEEDS = (3, 4)
EVERY = sorted(name for name in files.options("experiment") if not name.startswith("generic"))  # which has no environment of its own
EXPERIMENTS = [name for name in EVERY if not name.endswith("_paper")]  # which are others with another recipe
FILES = [(kind, name) for kind in kinds.KINDS for name in files.options(kind)]
FEW = {"first_steps": 4, "steps": 2, "updates": 4, "first_updates": 6, "width": 8, "batch": 8, "stride": 3}
SMALL: dict[str, dict[str, Any]] = {  # what makes an environment quick: two free cells, few demonstrations
    "PointMaze": {"env": {"maze": ["1111", "1001", "1111"], "start": [1, 1], "goal": [1, 2], "successes": 2}},
}
SMALL["PointMaze"]["env"] |= {"partials": 0, "failures": 1, "evaluation_episodes": 2}
SMALL["PointMaze"]["feedback"] = {"window": 40}
SHORT = {"windows_per_round": 2, "first_windows": 0, "random_windows": 0, "log_every": 4}
WINDOWS = 6  # of a short run


@cache
def composed(*overrides: str) -> dict[str, Any]:
    """The whole configuration of a short run, made small; not to be changed."""
    config = _less(registry.compose(["tracking=none", *overrides]))
    changes = SMALL.get(schema.resolve("env", config["env"]).__name__, {})
    config |= {slot: config[slot] | keys for slot, keys in changes.items()}
    return config | {"trainer": config["trainer"] | SHORT | {"steps": WINDOWS * config["feedback"]["window"]}}


def _less(node: Any) -> Any:
    """The same configuration with less work in it."""
    if isinstance(node, Mapping):
        return {key: FEW[key] if key in FEW else _less(value) for key, value in node.items()}
    return node


@cache
def checked(*overrides: str) -> tuple[list[str], set[str]]:
    """What is wrong with some overrides, and the slots that they use."""
    try:
        found = job.check(composed(*overrides))
    except UserError as error:  # there is nothing where an option would go
        return [str(error)], set()
    return list(found.problems), found.used


def problems_of(*overrides: str) -> list[str]:
    return checked(*overrides)[0]


def selection(kind: str, name: str) -> list[str]:
    """The override that puts an option where it is used."""
    return {
        "reward": [f"reward@reference={name}"],
        "features": [f"features@reference.features={name}"],
        "bonus": [f"bonus=[{name}]"],
        "tracking": [f"tracking={name}"],
    }.get(kind, [f"{kind}={name}"])


def options(kind: str) -> list[Any]:
    """Registered names of a kind."""
    return sorted(files.options(kind))

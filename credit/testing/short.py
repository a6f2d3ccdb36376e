"""Short runs of whatever is registered: configurations of credit's experiments, with little work in them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from credit.config import classes, files, registry, schema

SEEDS = (3, 4)
WINDOWS = 6  # of a short run
FEW = {"first_steps": 4, "steps": 2, "updates": 4, "first_updates": 6, "width": 8, "batch": 8, "stride": 3}
SHORT = {"windows_per_round": 2, "first_windows": 0, "random_windows": 0, "log_every": 4}
SMALL: dict[str, dict[str, Any]] = {  # what makes an environment quick: two free cells, few demonstrations
    "PointMaze": {
        "env": {"maze": ["1111", "1001", "1111"], "start": [1, 1], "goal": [1, 2], "successes": 2}
        | {"partials": 0, "failures": 1, "evaluation_episodes": 2},
    },
}
NEEDS: dict[str, tuple[str, ...]] = {  # an option → words for keys that have no value of their own
    "module": ("reference.network.module=torchrl.modules:MLP",),
    "convolution": ("reference.network.shape=[1,1,1]", "reference.network.kernel=1"),
}
LONGEST = 40  # steps of a window


@cache
def experiments() -> tuple[str, ...]:
    """The experiments that have an environment of their own and are not others with another recipe."""
    found = sorted(files.options("experiment"))
    return tuple(name for name in found if not (name.startswith("generic") or name.endswith("_paper")))


@cache
def composed(*overrides: str) -> dict[str, Any]:
    """The whole configuration of a short run, made small; not to be changed."""
    return small(registry.compose(["tracking=none", *overrides]))


def small(config: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration with less work in it, of `WINDOWS` windows.

    Args:
        config: of a job, whole and not checked.
    """
    worlds = {slot: config[slot] for slot in ("env", "feedback")}  # whose numbers say what they are, not what they cost
    found = {**_less(config), **worlds}
    changes = SMALL.get(classes.resolve("env", worlds["env"]).__name__, {})
    found |= {slot: found[slot] | keys for slot, keys in changes.items()}
    if isinstance(window := found["feedback"].get("window"), int) and window > LONGEST:
        found["feedback"] = found["feedback"] | {"window": LONGEST}
    return found | {"trainer": found["trainer"] | SHORT | {"steps": WINDOWS * window_of(found)}}


def window_of(config: Mapping[str, Any]) -> int:
    """T, most steps of a window: of the feedback, or of a whole episode."""
    return int(schema.build(config, "feedback").window or schema.build(config, "env").horizon or 1)


def _less(node: Any) -> Any:
    """The same configuration with less work in it."""
    if isinstance(node, Mapping):
        return {key: FEW[key] if key in FEW else _less(value) for key, value in node.items()}
    return node


def selection(kind: str, name: str) -> list[str]:
    """The override that puts an option where it is used."""
    needs = NEEDS.get(name, ())
    return {
        "reward": [f"reward@reference={name}"],
        "features": [f"features@reference.features={name}"],
        "network": ["reward@reference=dnn", "uncertainty=ensemble", f"+network@reference.network={name}", *needs],
        "bonus": [f"bonus=[{name}]"],
    }.get(kind, [f"{kind}={name}"])

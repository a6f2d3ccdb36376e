"""Settings: runs of one experiment that are shown different labels have different objectives, and are not compared.

A setting is told by the `feedback` node of a run's configuration, and named by the shortest name that tells it apart.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from credit.renamed import translated

# tuned.window and tuned.noise reach nothing but the feedback
_MAKES_SETTING = re.compile(r"[+~]*(feedback[.=@]|tuned\.(window|noise)=)")
# a comma stands before another override only where a key follows: lists have commas too
_BETWEEN = re.compile(r",(?=[+~]|[^,=]*=)")


def variant(slug: str) -> str:
    """What a slug says of a method, without the overrides that make the setting: `default` where nothing is left.

    Args:
        slug: the name of a run's folder, overrides separated by commas.
    """
    kept = [part for part in _BETWEEN.split(slug) if not _MAKES_SETTING.match(part)]
    return ",".join(kept) or "default"


def read_feedback(folder: Path) -> str:
    """The `feedback` node of a run's configuration, as text that is equal where two runs have the same labels.

    Raises:
        OSError: the configuration cannot be read.
        ValueError: it has no feedback.
    """
    try:
        feedback = translated(yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))["feedback"])
        return json.dumps({"_target_": feedback["_target_"], **feedback}, sort_keys=True)
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise ValueError(f"no feedback in config.yaml: {type(error).__name__}: {error}") from error


def name_settings(feedbacks: Iterable[str]) -> dict[str, str]:
    """Feedback → name, in the order of names: the rule, such as `terminal`, and what differs between alike ones.

    Args:
        feedbacks: texts of `read_feedback`.

    Returns:
        Names such as `block_sum`, or `block_sum-noise=0.5` beside another block_sum with other noise.
    """
    nodes: dict[str, dict[str, Any]] = {text: json.loads(text) for text in feedbacks}
    names = {}
    for text, node in nodes.items():
        alike = [other for other in nodes.values() if _rule(other) == _rule(node)]
        differing = [key for key in node if any(other.get(key) != node[key] for other in alike)]
        name = "-".join([_rule(node), *(f"{key}={node[key]}" for key in differing)])
        names[text] = re.sub(r"[^\w=.,+-]+", "-", name)
    return dict(sorted(names.items(), key=lambda item: item[1]))


def is_called(setting: str, wanted: str) -> bool:
    """Whether a setting goes by a name: its own, or that of its rule."""
    return wanted in (setting, setting.partition("-")[0])


def _rule(node: dict[str, Any]) -> str:
    """BlockSum → block_sum, as the options of `feedback` are spelled."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(node["_target_"]).rpartition(".")[2]).lower()

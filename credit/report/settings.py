"""Settings: what a run had to solve, and with how much. Runs of two settings are never compared with each other.

A setting is the problem and the budget of a run's configuration: all of its environment and of its feedback, and of the
trainer what is not the learner's own. It is named by the shortest name that tells it apart.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from credit.core.errors import UserError, nearest
from credit.core.naming import flat
from credit.renamed import translated

# The slots that are the problem, and what of the trainer is not: the learner's own schedule, and how often one looks
# (which decides what `eval/auc` and `eval/final` are means of: such runs are a variant, never averaged with others).
PROBLEM = ("env", "feedback")
SCHEDULE = (
    *("windows_per_round", "first_windows", "first_windows_per_round", "random_windows", "log_every"),
    *("steps_per_round", "random_steps"),
)
TRAINER = "trainer"
GIVEN = "demonstrations_from"  # steps that every method starts from: of the problem, where a run has them
BUDGET = ("steps", "episodes")

_LONGEST = 100  # letters of a name, which becomes part of file names

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Setting:
    """A setting beside others.

    Attributes:
        name: the shortest that tells it apart, fit for files; "" where nothing calls for a name.
        words: the same as one would type it, such as `feedback=terminal trainer.steps=700`.
        own: key → value of what not all of them share.
    """

    name: str = ""
    words: str = ""
    own: Values = field(default_factory=dict)


def read_setting(folder: Path) -> str:
    """The setting of a run, as text that is equal where two runs have the same.

    Raises:
        OSError: the configuration cannot be read.
        ValueError: it has no environment, feedback or trainer.
    """
    try:
        config = translated(yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8")))
        return json.dumps(values_of(config), sort_keys=True)
    except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"no setting in config.yaml: {type(error).__name__}: {error}") from error


def values_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """Key → value of all that makes the setting; a slot's own key, such as `feedback`, has the name of its class.

    Args:
        config: a run's configuration.

    Raises:
        KeyError: it has no environment, feedback or trainer, or one of them no class.
    """
    budget = {key: value for key, value in config[TRAINER].items() if key not in (*SCHEDULE, "_target_")}
    for key in BUDGET:  # one of which says nothing
        if budget.get(key) is None:
            budget.pop(key, None)
    nodes = {slot: {"_target_": config[slot]["_target_"], **config[slot]} for slot in PROBLEM}
    given = {} if config.get(GIVEN) is None else {GIVEN: config[GIVEN]}
    slots = {**nodes, TRAINER: budget, **given}
    return dict(sorted(pair for key, node in slots.items() for pair in flat(key, node)))


def name_settings(texts: Iterable[str]) -> dict[str, Setting]:
    """Each setting beside the others, in the order of their names.

    Args:
        texts: what `read_setting` gave.

    Returns:
        Settings with names such as `block_sum`, or `block_sum-noise=0.5` beside another block_sum with other noise:
        the rule of the feedback, then what differs between settings of the same class.
    """
    every: dict[str, dict[str, Any]] = {text: json.loads(text) for text in texts}
    values = every.values()
    common = common_values(every)
    telling = {text: _telling(one, values) for text, one in every.items()}
    ends = [_end(key) for key in {key for keys in telling.values() for key in keys}]
    found = {}
    for text, one in every.items():
        classes = {
            key: _rule(values, one, key) for key in ("feedback", "env") if key == "feedback" or key not in common
        }
        more = {key: typed(one[key]) for key in telling[text]}
        short = [f"{_end(key) if ends.count(_end(key)) == 1 else key}={value}" for key, value in more.items()]
        found[text] = Setting(
            name=file_name("-".join([*classes.values(), *short])),
            words=" ".join(f"{key}={value}" for key, value in {**classes, **more}.items()),
            own={key: value for key, value in one.items() if key not in common},
        )
    taken = [setting.name for setting in found.values()]
    for text, setting in found.items():
        if taken.count(setting.name) > 1:  # they differ in what no file name can have
            found[text] = replace(setting, name=f"{setting.name}-{zlib.crc32(text.encode()):08x}")
    return dict(sorted(found.items(), key=lambda item: item[1].name))


def common_values(texts: Iterable[str]) -> dict[str, Any]:
    """Key → value of what all these settings share.

    Args:
        texts: what `read_setting` gave.
    """
    values = [json.loads(text) for text in texts]
    return {key: value for key, value in values[0].items() if _shared(values, key)} if values else {}


def choose_settings(
    texts: Iterable[str], experiment: str, called: Collection[str] | None = None, where: Values | None = None
) -> dict[str, Setting]:
    """The settings that were asked for: named beside all others, their own values beside those that were asked for.

    Args:
        texts: what `read_setting` gave. experiment: for messages.
        called: only those with one of these names; all by default. where: only those with these values.

    Raises:
        UserError: no setting has such a name, or these values.
    """
    found = name_settings(texts)
    names = [setting.name for setting in found.values()]
    for wanted in called or ():
        if not any(is_called(name, wanted) for name in names):
            raise UserError(
                f"No finished run of experiment={experiment} that was asked for has feedback={wanted}; "
                f"{nearest(wanted, names)}."
            )
    chosen = {
        text: setting
        for text, setting in found.items()
        if has(text, where or {}) and (not called or any(is_called(setting.name, name) for name in called))
    }
    if not chosen:
        raise UserError(_none_has(found, where or {}, experiment))
    seen = name_settings(chosen)
    return {text: replace(each, own=seen[text].own) for text, each in chosen.items()}


def is_called(setting: str, wanted: str) -> bool:
    """Whether a setting goes by a name: its own, or that of its rule."""
    return wanted in (setting, setting.partition("-")[0])


def has(text: str, where: Values) -> bool:
    """Whether a setting, as text, has these values."""
    values = json.loads(text)
    return all(key in values and values[key] == value for key, value in where.items())


def describe(values: Values) -> str:
    """Key → value in one line, such as `feedback=block_sum (noise=0.2, window=7); trainer.steps=700`."""
    parts = []
    for root in (*PROBLEM, TRAINER):
        inner = {key: typed(value) for key, value in values.items() if key.startswith(f"{root}.")}
        if root in values:
            listed = ", ".join(f"{key.removeprefix(f'{root}.')}={value}" for key, value in inner.items())
            parts.append(f"{root}={_end(values[root])}" + (f" ({listed})" if listed else ""))
        elif inner:
            parts.append(", ".join(f"{key}={value}" for key, value in inner.items()))
    return "; ".join([*parts, *([f"{GIVEN}={values[GIVEN]}"] if GIVEN in values else [])])


def _none_has(texts: Iterable[str], where: Values, experiment: str) -> str:
    """Why no run has these values."""
    every = [json.loads(text) for text in texts]
    known = sorted({key for values in every for key in values})
    hints = []
    for key, value in where.items():
        present = sorted({typed(values[key]) for values in every if key in values})
        if not present:
            hints.append(f"{key} is no part of their settings, {nearest(key, known)}")
        elif typed(value) not in present:
            hints.append(f"there are runs with {key}={' and '.join(present)}")
    wanted = " ".join(f"{key}={typed(value)}" for key, value in where.items())
    why = "; ".join(hints) or "each value is there, but not together with all that was asked for"
    return f"No finished run of experiment={experiment} that was asked for has {wanted}: {why}."


def typed(value: Any) -> str:
    """A value as one would type it."""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"), sort_keys=True)


def _end(name: str) -> str:
    return name.rpartition(".")[2]


def _rule(every: Collection[Values], values: Values, key: str) -> str:
    """A class as its option is spelled, with its package where another one has a class of that name."""
    name = str(values[key])
    others = {str(other[key]) for other in every} - {name}
    return name if _end(name) in map(_end, others) else _end(name)


def _shared(every: Collection[Values], key: str) -> bool:
    return len({typed(values[key]) if key in values else None for values in every}) == 1


def _telling(values: Values, every: Collection[Values]) -> list[str]:
    """The parameters that set it apart from settings with the same class in that slot."""
    found = []
    for slot in (*PROBLEM, TRAINER):
        alike = [other for other in every if other.get(slot) == values.get(slot)]
        found += [key for key in values if key.startswith(f"{slot}.") and not _shared(alike, key)]
    return [*found, *([GIVEN] if GIVEN in values and not _shared(every, GIVEN) else [])]


def file_name(name: str) -> str:
    """A name that files can have; a long one ends in a checksum."""
    name = re.sub(r"[^\w=.,+-]+", "-", re.sub(r"[][{}\"]", "", name))
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 9]}-{zlib.crc32(name.encode()):08x}"

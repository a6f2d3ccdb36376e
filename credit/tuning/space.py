"""What is searched: words with an interval or several values, as Optuna's distributions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution

from credit.config import registry, schema, sweeps
from credit.core.errors import UserError
from credit.core.naming import flat
from credit.core.signatures import refusal, signature

EXAMPLES = {  # key → how it is searched
    "bonus.count.scale": "'interval(.05,1)'",
    "agent.learning_rate": "'tag(log,interval(1e-4,1e-2))'",
    "mixer.alpha": "'interval(.1,1)'",
    "reference.regularization": "'tag(log,interval(1e-2,1e2))'",
}
DIGITS = 4  # of a number from an interval: the run, its folder, the store and the words to type have the same
Value = Any  # a number, a truth value or a text


@dataclass(frozen=True)
class Space:
    """The words of a search.

    Attributes:
        fixed: words with one value. typed: key → what was typed for it. ranges: key → Optuna's distribution.
    """

    fixed: tuple[str, ...]
    typed: Mapping[str, str]
    ranges: Mapping[str, BaseDistribution]

    def words(self, values: Mapping[str, Value]) -> list[str]:
        """The words of a trial, by its value of each key."""
        return [f"{key}={_text(values[key])}" for key in self.ranges]

    def corners(self) -> list[dict[str, Value]]:
        """Trials in which every key has each of its ends, or of its choices, the others their first one."""
        ends = {key: _ends(found) for key, found in self.ranges.items()}
        first = {key: values[0] for key, values in ends.items()}
        others = [first | {key: value} for key, values in ends.items() for value in values[1:]]
        return [first, *others]

    def values_in(self, config: Mapping[str, Any]) -> dict[str, Value] | None:
        """What a configuration has for each key; None where the space does not hold that."""
        found = {}
        for key, allowed in self.ranges.items():
            try:
                value = schema.at(config, key)
            except (LookupError, TypeError):
                return None
            if not isinstance(value, int | float | str | None) or not _holds(allowed, value):
                return None
            found[key] = value
        return found

    def count(self) -> int | None:
        """How many settings there are; None where a key has no end of values."""
        total = 1
        for found in self.ranges.values():
            if isinstance(found, CategoricalDistribution):
                total *= len(found.choices)
            elif isinstance(found, IntDistribution) and not found.log:
                total *= (found.high - found.low) // found.step + 1
            elif isinstance(found, FloatDistribution) and found.step:
                total *= round((found.high - found.low) / found.step) + 1
            else:
                return None
        return total


def read(overrides: Sequence[str], config: Mapping[str, Any], config_dirs: Sequence[str] = ()) -> Space:
    """The space that words span.

    Args:
        overrides: as on the command line, with `interval(…)`, `tag(log,interval(…))`, `range(…)`, `choice(…)`, `a,b`.
        config: of the words that have one value; it tells whole numbers from others.
        config_dirs: further folders of YAML files.

    Raises:
        UserError: with every word that cannot be searched.
    """
    typed, ranges, problems = dict[str, str](), dict[str, BaseDistribution](), list[str]()
    for text in searched(overrides):
        try:
            named = sweeps.named(text, config_dirs)
            ranges[named.key] = _range(named, text, _wants_whole(config, named.path))
            typed[named.key] = text.partition("=")[2]
        except UserError as error:
            problems.append(str(error))
    if problems:
        raise UserError("\n".join(problems))
    if not ranges:
        known = dict(flat("", config))
        own = [f"{key}={value}" for key, value in EXAMPLES.items() if key in known]
        such = f", such as {', '.join(own)}" if own else ""
        raise UserError(f"nothing is searched; give a key an interval or several values{such} (keys: credit check)")
    return Space(tuple(text for text in overrides if not registry.is_sweep(text)), typed, ranges)


def searched(overrides: Sequence[str]) -> list[str]:
    """The words that have an interval or several values."""
    return [text for text in overrides if registry.is_sweep(text)]


def rounded(value: float, allowed: FloatDistribution) -> float:
    """A number of an interval by its first digits, in the interval."""
    if allowed.step:
        return float(f"{value:.12g}")  # .1 + 2·.1 is not .30000000000000004
    return min(max(float(f"{value:.{DIGITS}g}"), allowed.low), allowed.high)


def _range(named: sweeps.Named, text: str, whole: bool) -> BaseDistribution:
    log = "log" in named.tags
    if named.tags - {"log"} or (log and named.kind != "interval"):
        raise UserError(f"{text!r}: a tag is log, and of an interval: tag(log,interval(1e-4,1e-2))")
    if named.kind == "choice":  # Optuna's store holds numbers and texts: other values as they are typed
        pairs = zip(named.values, named.texts, strict=True)
        return CategoricalDistribution([item if isinstance(item, int | float) else shown for item, shown in pairs])
    low, high = min(named.values), max(named.values)
    if log and low <= 0:
        raise UserError(f"{text!r}: a logarithm is of numbers above 0, and {low} is none; begin above 0")
    steps = abs(named.values[1] - named.values[0]) if named.kind == "range" and low < high else None
    if all(isinstance(end, int) or (whole and end.is_integer()) for end in (low, high, steps or 1)):
        return IntDistribution(int(low), int(high), log=log, step=int(steps or 1))
    return FloatDistribution(float(low), float(high), log=log, step=steps and float(f"{steps:.12g}"))


def _wants_whole(config: Mapping[str, Any], key: str) -> bool:
    """Whether a key takes whole numbers alone."""
    place, _, name = key.rpartition(".")
    try:
        node = schema.at(config, place) if place else {}
        hint = signature(schema.resolve(place, node))[name][0] if schema.is_component(node) else None
    except (UserError, LookupError, TypeError):
        return False
    return hint is not None and refusal(hint, 1.5) is not None and "integer" in str(refusal(hint, 1.5))


def _ends(found: BaseDistribution) -> list[Value]:
    if isinstance(found, CategoricalDistribution):
        return [*found.choices]
    assert isinstance(found, IntDistribution | FloatDistribution)
    return [found.low, found.high]


def _holds(allowed: BaseDistribution, value: Value) -> bool:
    if isinstance(allowed, CategoricalDistribution):
        return value in allowed.choices
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and bool(allowed._contains(allowed.to_internal_repr(value)))


def _text(value: Value) -> str:
    return value if isinstance(value, str) else json.dumps(value)

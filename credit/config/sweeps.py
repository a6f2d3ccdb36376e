"""The jobs of a sweep: several values of words on the command line, or a file that stands for such words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hydra.core.override_parser.types import Glob, IntervalSweep, Override, RangeSweep

from credit.config import files, registry
from credit.core.errors import UserError, nearest


@dataclass(frozen=True)
class Named:
    """What a word with several values names.

    Attributes:
        key: as it is typed, with its + and @. path: where it is in a configuration.
        kind: an `interval` has all values between two; a `range` is numbers at equal steps; `choice` is any list.
        values: two ends, or all of them. texts: the same as they are typed. tags: of `tag(log,interval(…))`.
    """

    key: str
    path: str
    kind: Literal["interval", "range", "choice"]
    values: tuple[Any, ...]
    texts: tuple[str, ...]
    tags: frozenset[str]


def named(text: str, config_dirs: Sequence[str] = ()) -> Named:
    """What a word with an interval or several values names.

    Raises:
        UserError: it names nothing.

    Example:
        >>> named("mixer.alpha=interval(.1,1)").values
        (0.1, 1.0)
    """
    override = registry.parse(text)
    value, key, path = override.value(), str(override.get_key_element()), str(override.key_or_group)
    tags = frozenset(getattr(value, "tags", ()))
    if isinstance(value, IntervalSweep):
        ends = (value.start, value.end)
        if value.start is None or value.end is None or not value.start < value.end:
            raise UserError(f"{text!r} has no values: it goes from {value.start} to {value.end}")
        return Named(key, path, "interval", ends, tuple(map(str, ends)), tags)
    listed = finite(override, text, config_dirs)
    texts = dict(zip(listed.sweep_string_iterator(), listed.sweep_iterator(), strict=True))
    if mappings := [shown for shown, item in texts.items() if isinstance(item, Mapping)]:
        raise UserError(
            f"{text!r}: {mappings[0]} is a mapping, and no value; choose among the options of a group, such as "
            "mixer=best,relative_mse, or search its keys one by one"
        )
    kind: Literal["range", "choice"] = "range" if isinstance(value, RangeSweep) else "choice"
    return Named(key, path, kind, tuple(texts.values()), tuple(texts), tags)


def expand(overrides: Sequence[str], config_dirs: Sequence[str] = ()) -> list[list[str]]:
    """The overrides of every job of a sweep, in the order in which Hydra's basic sweeper has them.

    `sweep=<name>` stands for the words in its file: those in `hydra.sweeper.params`, and once more for each of
    `sweep.rows` with the words of that row. Of two words for one key the later counts: params, row, command line.

    Raises:
        UserError: an override cannot be parsed, names no values, or there is no such file.

    Example:
        >>> expand(["method=block,delayed", "seed=0"])
        [['method=block', 'seed=0'], ['method=delayed', 'seed=0']]
    """
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper

    registry.require_words(overrides, config_dirs)
    typed = [text for text in overrides if not registry.is_sweep_file(text)]
    named = [text for text in overrides if registry.is_sweep_file(text)]
    jobs: list[list[str]] = []
    for words in _words(named, config_dirs) if named else [[]]:
        parsed = [finite(registry.parse(text), text, config_dirs) for text in (*words, *typed)]
        kept = [override for override in parsed if not override.key_or_group.startswith("hydra")]
        jobs += BasicSweeper.split_arguments(kept, max_batch_size=None)[0]
    return jobs


def _words(named: list[str], config_dirs: Sequence[str]) -> list[list[str]]:
    """The words that a sweep's file stands for: one list for its grid, and one for each of its rows."""
    if len(named) > 1 or registry.is_sweep(named[0]):
        raise UserError(f"{' '.join(named)}: one sweep at a time; run one after the other")
    config = registry.hydra_node(named, config_dirs, whole=True)
    grid = [f"{key}={value}" for key, value in (config["hydra"]["sweeper"]["params"] or {}).items()]
    return [grid, *([*grid, *row.split()] for row in config["sweep"].get("rows", ()))]


def finite(override: Override, text: str, config_dirs: Sequence[str] = ()) -> Override:
    """An override whose values can be counted: options that a pattern names are listed.

    Raises:
        UserError: there are none, or they cannot be counted.
    """
    value: Any = override.value()
    if isinstance(value, IntervalSweep):
        raise UserError(f"{text!r} is an interval, whose values cannot be listed; say 0,.5,1 or range(0,1,.25)")
    if isinstance(value, RangeSweep):
        step = value.step
        if not step or (value.stop - value.start) / step <= 0:
            raise UserError(f"{text!r} has no values: it goes from {value.start} to {value.stop} in steps of {step}")
    if isinstance(value, Glob):
        options = files.options(str(override.key_or_group), config_dirs)
        if not options:
            raise UserError(f"{text!r}: a pattern chooses among the options of a group, and this is none; list values")
        if not (found := value.filter(list(options))):
            raise UserError(f"{text!r} fits no option; {nearest(' '.join(value.include), options)}")
        return registry.parse(f"{override.get_key_element()}={','.join(found)}")
    return override

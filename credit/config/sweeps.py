"""The jobs of a sweep: several values of words on the command line, or a file that stands for such words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hydra.core.override_parser.types import Glob, IntervalSweep, Override, RangeSweep

from credit.config import files, registry
from credit.core.errors import UserError, nearest


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


def finite(override: Override, text: str, config_dirs: Sequence[str]) -> Override:
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

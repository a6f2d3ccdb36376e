"""How rows are called in figures, where room is short: what all have in common is said once, in the title."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence

from credit.core.naming import short_keys
from credit.report.comparison import Comparison
from credit.report.groups import Key
from credit.report.runs import Runs
from credit.report.text import heading, span
from credit.report.variants import overrides

LETTERS = 34  # of a line
LINES = 4  # below the method's name
_KEY = re.compile(r"([\w.]+)=(.*)", re.DOTALL)


def title(comparisons: Sequence[Comparison]) -> str:
    """Experiment, setting where there is one, what was typed for all runs, and the number of seeds.

    Args:
        comparisons: one a setting.
    """
    runs = comparisons[0].runs
    setting = heading(runs).split() if len(comparisons) == 1 else []
    common, of_methods = common_overrides(comparisons)
    own = [f"{method} with {', '.join(words)}" for method, words in of_methods.items() if words]
    seeds = span(row["n"] for comparison in comparisons for row in comparison.rows)
    counted = f"n = {seeds} {'seed' if seeds == '1' else 'seeds'}"
    said = ", ".join([runs.experiment, *dict.fromkeys([*setting, *common]), counted])
    return "; ".join([said, *own])


def circumstances(runs: Runs, slug: str) -> str:
    """What is said in brackets behind a method's name: its setting, and what was typed for all runs of this.

    Args:
        runs: of one setting. slug: what the method's name says already.
    """
    typed = _in_all(overrides(str(words)) for words in runs.frame["typed"])
    said = overrides(slug)
    words = dict.fromkeys(word for word in (*heading(runs).split(), *typed) if word not in said)
    return f" ({', '.join(words)})" if words else ""


def common_overrides(comparisons: Sequence[Comparison]) -> tuple[list[str], Mapping[str, list[str]]]:
    """What was typed for all runs beside their method, and method's name → what was typed for all its variants, too.

    Args:
        comparisons: one a setting.
    """
    typed = {str(words) for comparison in comparisons for words in comparison.runs.frame["typed"]}
    common = _in_all(map(overrides, typed))
    variants: dict[str, set[str]] = {}
    for comparison in comparisons:
        for _, slug, group in comparison.groups:
            variants.setdefault(str(group["name"].iloc[0]), set()).add(slug)
    own = {name: _in_all(map(overrides, slugs)) for name, slugs in variants.items() if len(slugs) > 1}
    return common, {name: [word for word in words if word not in common] for name, words in own.items()}


def row_names(comparisons: Sequence[Comparison]) -> Mapping[Key, str]:
    """What each method and variant is called: its name, and below it what sets it apart, its keys as short as can be.

    Args:
        comparisons: one a setting.

    Example:
        `Ridge-UCB (bonus.count.scale=0.1,mixer.alpha=0.3)` is `Ridge-UCB`, and below it `scale=0.1, alpha=0.3`.
    """
    common, of_methods = common_overrides(comparisons)
    rows = [row for comparison in comparisons for row in comparison.groups]
    titles = {(method, slug): str(group["name"].iloc[0]) for method, slug, group in rows}
    said = {key: {*common, *of_methods.get(name, [])} for key, name in titles.items()}
    own = {key: [word for word in overrides(key[1]) if word not in said[key]] for key in titles}
    short = short_keys(match[1] for words in own.values() for word in words if (match := _KEY.fullmatch(word)))
    below = {key: ", ".join(_shortened(word, short) for word in words) for key, words in own.items()}
    for lines in (LINES, None):
        names = {key: "\n".join([titles[key], *_folded(below[key], lines)]) for key in titles}
        if len(set(names.values())) == len(names):
            break
    return names


def letters(names: Iterable[str]) -> int:
    """The letters of the longest line."""
    return max(len(line) for name in names for line in name.split("\n"))


def _in_all(slugs: Iterable[list[str]]) -> list[str]:
    """The words that all of these have, in the order of the first by name."""
    first, *others = sorted(slugs)
    return [word for word in first if all(word in other for other in others)]


def _shortened(word: str, short: Mapping[str, str]) -> str:
    match = _KEY.fullmatch(word)
    return f"{short[match[1]]}={match[2]}" if match else word


def _folded(words: str, lines: int | None) -> list[str]:
    if lines is None:
        return textwrap.wrap(words, LETTERS, break_on_hyphens=False)
    return textwrap.wrap(words, LETTERS, break_on_hyphens=False, max_lines=lines, placeholder=" …")

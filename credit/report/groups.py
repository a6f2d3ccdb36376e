"""The rows of a table: the runs of each method and variant, their order, and the one that others are compared to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from credit.core.errors import UserError
from credit.report.variants import nearest_of, overrides, spelled

# The paper's methods in the order of its Table 1.
PAPER_METHODS = ("block", "delayed", "reference", "adaptive_mse", "disagreement")
REFERENCE = "reference"  # the method that others are compared to, where nobody says another
DEFAULT = "default"

Key = tuple[str, str]  # method and variant
Group = tuple[str, str, pd.DataFrame]


def ordered_groups(frame: pd.DataFrame) -> list[Group]:
    """The runs of each method and variant, the paper's methods first and in the paper's order.

    Args:
        frame: rows of `Runs.frame`.
    """

    def position(key: Key) -> tuple[int, str, bool, str]:
        """What to sort by."""
        method, slug = key
        # What goes beyond the paper follows by name.
        rank = PAPER_METHODS.index(method) if method in PAPER_METHODS else len(PAPER_METHODS)
        return rank, method, slug != DEFAULT, slug

    groups = {(str(m), str(s)): group for (m, s), group in frame.groupby(["method", "slug"])}
    return [(*key, groups[key]) for key in sorted(groups, key=position)]


def display_name(group: pd.DataFrame) -> str:
    """The method's name as tables show it, with its slug where it is a variant."""
    name, slug = str(group["name"].iloc[0]), str(group["slug"].iloc[0])
    return name if slug == DEFAULT else f"{name} ({slug})"


def several_titles(frame: pd.DataFrame) -> str:
    """What is to be said where runs of one row were given different titles; empty where they were not."""
    parts = []
    for method, slug, group in ordered_groups(frame):
        if group["name"].nunique() > 1:
            by_title = group.sort_values("seed").groupby("name", sort=False)["seed"]
            titles = ", ".join(f"{title!r} (seeds {', '.join(map(str, seeds))})" for title, seeds in by_title)
            row = method if slug == DEFAULT else f"{method}/{slug}"
            parts.append(f"{row} has {titles} and is called {display_name(group)}")
    if not parts:
        return ""
    return f"Runs of one row have several titles, which are for display and tell no runs apart: {'; '.join(parts)}."


def best_first(keys: Iterable[Key], means: Mapping[Key, float], lower_is_better: bool) -> list[Key]:
    """Methods and variants by their means; those without one come last, equal ones stay as they are."""
    sign = 1.0 if lower_is_better else -1.0
    return sorted(keys, key=lambda key: (pd.isna(means[key]), 0.0 if pd.isna(means[key]) else sign * means[key]))


@dataclass(frozen=True)
class Reference:
    """The row that the others are compared to; `key` is None where there is none.

    `remark` is what a reader has to be told: why there is none, or why this one was taken.
    """

    key: Key | None = None
    remark: str = ""


def choose_reference(groups: Sequence[Group], wanted: str | None, ranking: Sequence[Key]) -> Reference:
    """The row that the others are compared to.

    A method stands for its default variant. Where it has none, for the one with the fewest overrides, of those with the
    most seeds, and of those the one that ranks first; that is said.

    Args:
        groups: the rows of one setting.
        wanted: a name, as in `require_reference`; None is the method `reference`, or the only method.
        ranking: all rows, the best first.

    Raises:
        UserError: several methods have the variant that is wanted.
    """
    methods = list(dict.fromkeys(method for method, _, _ in groups))
    if wanted is None:
        wanted = methods[0] if len(methods) == 1 and len(groups) > 1 else REFERENCE
        if wanted not in methods:
            hint = f"; `reference=…` names one: {', '.join(methods)}" if len(methods) > 1 else ""
            return Reference(None, f"No run of the reference method is among these: no differences are shown{hint}.")
    known = [_own_names(*group) for group in groups]
    wanted = spelled(wanted, set[str]().union(*known))
    variants = [(method, slug) for (method, slug, _), names in zip(groups, known, strict=True) if wanted in names]
    if len(variants) > 1:
        full = " or ".join(f"reference={method}/{slug}" for method, slug in variants)
        raise UserError(f"reference={wanted} names several rows; write {full}")
    if variants:
        return Reference(variants[0])
    return _of_method([group for group in groups if group[0] == wanted], wanted, ranking)


def _of_method(groups: Sequence[Group], method: str, ranking: Sequence[Key]) -> Reference:
    if not groups:
        return Reference(None, f"No run of {method} is among these: no differences are shown.")
    if any(slug == DEFAULT for _, slug, _ in groups):
        return Reference((method, DEFAULT))

    def fitness(group: Group) -> tuple[int, int]:
        """Overrides, and seeds that are missing; fewer are better."""
        return len(overrides(group[1])), -len(group[2])

    fittest = min(map(fitness, groups))
    titles = {(m, slug): display_name(group) for m, slug, group in groups if fitness((m, slug, group)) == fittest}
    chosen = next(key for key in ranking if key in titles)
    if len(groups) == 1:
        return Reference(chosen)
    why = "its variant with the fewest overrides, and the most seeds"
    if len(titles) > 1:
        why = f"the best of the {len(titles)} variants with the fewest overrides and most seeds, which flatters it"
    said = f"{method} has no default variant here, so the others are compared to {titles[chosen]}, {why}"
    return Reference(chosen, f"{said}; `reference=VARIANT` names another.")


def require_reference(groups: Iterable[Group], wanted: str, experiment: str) -> None:
    """Stop where no row goes by this name: METHOD, VARIANT (with or without what makes the setting) or METHOD/VARIANT.

    Args:
        groups: the rows of all settings. wanted: what was asked for. experiment: for the message.

    Raises:
        UserError: no method or variant of that name is among them.
    """
    rows = list(groups)
    names = {row[0] for row in rows}.union(*(_own_names(*row) for row in rows))
    if spelled(wanted, names) not in names:
        shown = {name for method, slug, _ in rows for name in (method, slug)}
        raise UserError(
            f"reference={wanted}: no method or variant of that name is among the runs of experiment={experiment} that "
            f"were asked for; {nearest_of(wanted, shown)}"
        )


def _own_names(method: str, slug: str, group: pd.DataFrame) -> set[str]:
    return {slug, f"{method}/{slug}", *group["typed"], *(Path(folder).parent.name for folder in group["folder"])}

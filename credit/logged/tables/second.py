"""Labels in a second table, which has one row a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from credit.core.errors import UserError, nearest
from credit.logged.panel import Floats, Roles, Windows
from credit.logged.tables import guesses
from credit.logged.tables.columns import codes, numbers
from credit.logged.tables.guesses import Sample
from credit.logged.tables.keys import hashed
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    import pandas as pd


def in_second(words: Words, sample: Sample, labels: pd.DataFrame, group: str | None) -> tuple[str, str, str | None]:
    """Window and label where labels are in a second table, and the group."""
    columns = [str(name) for name in labels.columns]
    common = [name for name in columns if name in sample.kinds]
    if words.window and words.window not in columns:
        raise UserError(
            f"data.labels: there is no column {words.window!r} (data.window); {nearest(words.window, columns)}"
        )
    if words.label and words.label not in columns:
        raise UserError(
            f"data.labels: there is no column {words.label!r} (data.label); {nearest(words.label, columns)}"
        )
    choice = [name for name in common if name not in (group, words.label)] or common
    window = words.window or min(choice, key=lambda name: guesses.named(name, guesses.WINDOW) or 99, default=None)
    if window is None:
        raise UserError(
            f"data.labels has the columns {', '.join(columns)}, and none is in {sample.source}; both need the window's"
        )
    second = Sample(labels, "data.labels")
    if group is None and words.group is None:  # what else the tables share tells windows of the same name apart
        group = next((name for name in common if name not in (window, words.label) and second.levels(name) > 1
                      and sample.kinds[name] == "category"), None)  # fmt: skip
    rest = [name for name in columns if name not in (window, group) and second.kinds[name] == "number"]
    rest = [name for name in rest if name not in sample.kinds] or rest
    called = [name for name in rest if guesses.named(name, guesses.LABEL) is not None] or rest
    if not words.label and len(called) != 1:
        raise UserError(
            f"data.labels: which column is the label cannot be told ({', '.join(columns)}); say data.label=…"
        )
    return window, words.label or called[0], group


def joined(windows: Windows, table: pd.DataFrame, roles: Roles, source: str) -> tuple[Floats, list[str]]:
    """Labels of windows from a second table [W], and what there is to say.

    Args:
        table: one row a window: columns of the window, perhaps of the group, and the label. source: its name.

    Raises:
        UserError: a window that is there twice, or none that fits.
    """
    rows = np.arange(len(table))
    label = numbers(table[roles.label], rows, source, "the label")
    group, groups, own, own_groups = np.zeros(len(table), np.int64), ("all",), windows.group, windows.groups
    if roles.group is not None and roles.group in table.columns:
        group, names = codes(table[roles.group])
        groups = tuple(names)
    elif roles.group is not None:
        own, own_groups = np.zeros(len(windows), np.int64), ("all",)
    key = hashed(table[roles.window].to_numpy(), group, groups)
    mine = hashed(windows.id, own, own_groups)
    order = np.argsort(key, kind="stable")
    twice = np.flatnonzero(key[order][1:] == key[order][:-1])
    if len(twice):
        at = int(order[twice + 1].min())
        raise UserError(
            f"{source}: {roles.window} {table[roles.window].iloc[at]} is there twice, again in row {at}; keep one"
        )
    if len(np.unique(mine)) < len(mine):
        raise UserError(
            f"{source}: there is no column {roles.group!r}, and several groups have windows of the same name; say "
            "whose each label is"
        )
    place = np.minimum(np.searchsorted(key[order], mine), len(key) - 1)
    fits = key[order][place] == mine
    if not fits.any():
        raise UserError(
            f"{source}: none of its windows ({_some(table[roles.window])}) is one of the steps ({_some(windows.id)}); "
            f"{roles.window} must be written alike in both"
        )
    found = np.where(fits, label[order][place], np.nan)
    said = []
    if (more := len(key) - int(fits.sum())) > 0:
        said.append(f"{more} of the {len(key)} windows in {source} have no steps, and are left out")
    return found, said


def _some(values: Any) -> str:
    return ", ".join(str(value) for value in list(values[:3]))

"""Which code made a run: credit's version and commit. Where runs of one table differ in it, that is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from credit.core.errors import UserError

COLUMNS = ("git_commit", "version")
UNKNOWN = "unknown"
_CHANGED = "-dirty"  # how `git describe` marks a checkout with changes that are not committed
_SHORT = 10  # digits of a commit that are shown


def code_of(summary: Mapping[str, Any]) -> dict[str, str | None]:
    """The columns of a run that say which code made it, None where its summary does not.

    Args:
        summary: a run's summary.json.
    """
    return {"git_commit": summary.get("git_commit"), "version": (summary.get("versions") or {}).get("credit")}


def choose_commits(frame: pd.DataFrame, wanted: Sequence[str], experiment: str) -> pd.DataFrame:
    """The runs that were made by these commits.

    Args:
        frame: runs, with the columns of `code_of`.
        wanted: first digits of commits, with `-dirty` for a checkout that was changed; a run outside a checkout goes by
            its version instead.
        experiment: for the message.

    Raises:
        UserError: no run, or runs of several commits, have these first digits.
    """
    names = _names(frame)
    chosen: set[str] = set()
    for first in wanted:
        found = sorted({name for name in names if _matches(name, first)})
        if len(found) != 1:
            listed = ", ".join(
                f"{_shown(str(name))} ({number} runs)" for name, number in names.value_counts(sort=False).items()
            )
            problem = f"is short for {len(found)} of them" if found else "is none of them"
            raise UserError(
                f"commit={first} {problem}: the runs of experiment={experiment} that were asked for are of "
                f"{listed}. Give the first digits of one, or several with commas between."
            )
        chosen |= set(found)
    return frame[names.isin(chosen)].reset_index(drop=True)


def differing_code(frame: pd.DataFrame) -> str:
    """What is to be said where runs of one table were made by different code; empty where they were not.

    Args:
        frame: the runs of a table.
    """
    code = frame.assign(code=_names(frame), version=frame["version"].fillna(UNKNOWN))
    groups = list(code.groupby(["version", "code"], sort=False))
    if len(groups) == 1:
        return ""
    parts = []
    for (version, name), group in groups:
        methods = ", ".join(f"{title} {len(runs)}" for title, runs in group.groupby("name", sort=False))
        which = f"version {version}" + ("" if name == version else f", commit {_shown(str(name))}")
        parts.append(f"{which} (runs of {methods})")
    return (
        f"These runs were made by different code, which may be why they differ: {'; '.join(parts)}. "
        "`commit=…` chooses among them."
    )


def _names(frame: pd.DataFrame) -> pd.Series[str]:
    """What `commit=` calls each run's code."""
    return frame["git_commit"].fillna(frame["version"]).fillna(UNKNOWN).astype(str)


def _matches(name: str, first: str) -> bool:
    changed = name.endswith(_CHANGED)
    return changed == first.endswith(_CHANGED) and name.startswith(first.removesuffix(_CHANGED))


def _shown(name: str) -> str:
    commit = name.removesuffix(_CHANGED)
    return commit[:_SHORT] + name[len(commit) :]

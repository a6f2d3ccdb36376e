"""What a search has found, and what is said of it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from credit.cli.outcome import shown
from credit.cli.output import page
from credit.report.comparison import Comparison
from credit.report.statistics import mean_and_error
from credit.report.terminal import terminal_tables
from credit.report.text import sentences
from credit.tuning.study import STORE

if TYPE_CHECKING:
    from credit.cli.search import Search


@dataclass(frozen=True, repr=False)
class Tuned:
    """What a search found.

    Attributes:
        best: words of the best setting; empty before any trial has a value. number: of its trial.
        metric: what was tuned. trials: a row a trial. folder: the study's.
        comparison: of the best and the default setting on the seeds of the report; None where there is none.
        same: whether the best setting is the default. ended: whether all came to its end.
    """

    best: list[str]
    number: int | None
    metric: str
    trials: pd.DataFrame
    folder: Path
    comparison: Comparison | None = None
    same: bool = False
    ended: bool = False

    def __repr__(self) -> str:
        """In a line."""
        return f"Tuned({' '.join(self.best) or 'nothing'}: {len(self.trials)} trials of {self.metric}, {self.folder})"


def said(search: Search, found: Tuned) -> None:
    """Print what was found, on which seeds, and what to type next."""
    console = page()
    states = found.trials["state"].value_counts()
    counts = {"COMPLETE": "done", "FAIL": "failed", "RUNNING": "interrupted"}
    told = ", ".join(f"{states[state]} {word}" for state, word in counts.items() if state in states)
    rows = [f"trials   {told or 'none'}; tuned on seeds {span(search.job.seeds)}"]
    if found.number is not None:
        rows.append(f"best     {line(found.trials.loc[found.number], found.number, found.metric)}")
    if found.same:
        rows.append("report   none, since the default is the best")
    elif found.comparison:
        rows.append(f"report   on seeds {span(search.reported)}, which had no say in the choice:")
    for row in rows:
        console.print(row, soft_wrap=True)
    if found.comparison:
        console.print()
        for table in terminal_tables(found.comparison, console.width):
            console.print(table, "")
        for sentence in sentences(found.comparison):
            console.print(sentence)
        console.print()
    if "RUNNING" in states:
        console.print("next     the same command goes on with what was interrupted", soft_wrap=True)
    for place, command in following(search, found).items():
        console.print(f"{place:<8} {command}", soft_wrap=True)


def following(search: Search, found: Tuned) -> dict[str, str]:
    """What to type next: for more seeds of the best setting, for figures, for the study itself."""
    job, seeds = search.job, f"seed={search.reported.start} replicas={len(search.reported)}"
    where = [] if job.output == "outputs" else [f"output={job.output}"]
    words = {"open": f"optuna-dashboard {shlex.quote(str(shown(found.folder / STORE)))}"}
    if found.best and not found.same:
        best = shlex.join([*without(search.space.fixed, "seed", "replicas"), *found.best])
        words["train"] = f"credit train {best} {seeds if search.reported else ''}".rstrip()
    if found.comparison:
        names = dict.fromkeys(Path(folder).parent.name for folder in found.comparison.runs.frame["folder"])
        chosen = [f"experiment={job.experiment}", f"method={job.method}", *(f"variant={name}" for name in names)]
        chosen += [*seeds.split(), f"metric={search.metric}", *where]
        words["compare"] = shlex.join(["credit", "compare", *chosen])
    return words


def line(row: Any, number: int, metric: str) -> str:
    """A trial in a line: what it is, and what it came to.

    Args:
        row: of `Study.frame`. number: of the trial. metric: what is tuned.
    """
    mean, error = mean_and_error(row["scores"] or [math.nan])
    told = f"{mean:.4g}" if math.isnan(error) else f"{mean:.4g} ± {error:.2g}"
    return f"trial {number}{' (the default)' if row['default'] else ''}: {row['words']}: {metric} {told}"


def span(seeds: Sequence[int]) -> str:
    """Seeds as their first and last."""
    return f"{seeds[0]}–{seeds[-1]}" if len(seeds) > 1 else str(seeds[0])


def without(words: Sequence[str], *keys: str) -> list[str]:
    """Words that are not for these keys."""
    return [word for word in words if word.partition("=")[0] not in keys]

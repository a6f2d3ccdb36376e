"""What a recovery says, in sentences for a reader who has never heard of a standard error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.panel import MIXTURE
from credit.logged.report.figures import named
from credit.logged.report.gathered import Gathered
from credit.logged.report.numbers import interval, number, percent, short

if TYPE_CHECKING:
    from credit.logged.result import LoggedCredit

NAMED = 5  # things that are listed in a sentence
LABEL = {
    "sum": "the sum of what its rows brought",
    "mean": "the mean of what its rows brought",
    "last": "what its last row brought",
    "binary": "yes or no; the sum of its rows’ credit is the log-odds of yes",
}


def listed(words: Sequence[str], most: int = NAMED) -> str:
    """Words with commas between them, and how many more there are."""
    shown = [short(word) for word in words[:most]]
    if len(words) > most:
        shown.append(f"{len(words) - most} more")
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def main_effects(result: LoggedCredit) -> list[dict[Any, Any]]:
    """What each action was worth by the mixture, or by the only model; the largest total first."""
    frame = result.effects[result.effects["model"] == result.models[-1]]
    lines = frame.to_dict("records")
    return sorted(lines, key=lambda line: -abs(line["total"]) if line["total"] == line["total"] else 1.0)


def what(result: LoggedCredit, data: Gathered) -> str:
    """What the table is, and what is explained."""
    panel = result.found.panel
    roles, windows = panel.roles, panel.windows
    groups = f" of {len(windows.groups):,} series ({short(roles.group)})" if roles.group else ""
    span = f", from {short(data.when[0])} on" if roles.time else ""
    labelled = int(windows.labelled.sum())
    known = "Of each window" if labelled == len(windows) else f"Of {labelled:,} of these windows"
    return (
        f"The table has {panel.rows:,} rows{groups} in {len(windows):,} windows ({short(roles.window)}){span}. "
        f"{known} one thing is known, {short(roles.label)}: {LABEL[roles.label_is]}. This page says how much of it "
        "each row is expected to have brought: its credit."
    )


def worth(result: LoggedCredit) -> str:
    """The largest effects in a sentence; a word on those that may be nothing."""
    lines = main_effects(result)
    if not lines:
        return "No column was named as an action, so that nothing is said of what actions were worth."
    told = [line for line in lines if line["total"] == line["total"] and line["rows"]]
    sure = [line for line in told if _sure(line)]
    found = []
    shown = (sure or told)[:3]
    if shown:
        parts = [f"{named(line)} ({_total(result, line)})" for line in shown]
        found.append(f"The largest part goes with {listed(parts, 3)}.")
    if sure and (none := [named(line) for line in told if not _sure(line) and np.isfinite(line["total_low"])]):
        found.append(f"Of {listed(none)} it cannot be said whether it brought anything: the interval holds 0.")
    if untold := [named(line) for line in lines if not line["told"] and line["rows"]]:
        found.append(f"Of {listed(untold)} these windows tell nothing, and no number is given.")
    return " ".join(found)


def _sure(line: dict[Any, Any]) -> bool:
    return bool(line["total_low"] > 0 or line["total_high"] < 0)


def _total(result: LoggedCredit, line: dict[Any, Any]) -> str:
    value, between = interval(line["total"], line["total_low"], line["total_high"])
    whole = _whole(result)
    share = f", {percent(line['total'] / whole)} of all" if 0 < line["total"] <= whole else ""
    return f"{value}{f', interval {between}' if between else ''}{share}"


def _whole(result: LoggedCredit) -> float:
    """What all rows are expected to bring; NaN where labels are no sums."""
    if result.found.panel.roles.label_is != "sum":
        return float("nan")
    return float(result.rows.credit.sum())


def predicts(result: LoggedCredit) -> Iterator[str]:
    """How well windows are predicted that were not seen, against two yardsticks."""
    found = result.found
    alike, last = result.r_squared[result.models[-1]]
    if not np.isfinite(alike):
        yield "There are too few windows to hold some out: it is not known how well credit predicts."
        return
    yield (
        f"{len(found.folds.of)} stretches of time were left out, one after the other, with the windows around them, "
        "and predicted from the rest."
    )
    yield f"Against the guess that all rows are alike, {_smaller(alike)}."
    if np.isfinite(last):
        yield f"Against the guess that a row is worth what it was in the last window, {_smaller(last)}."
    if max(alike, 0) <= 0:
        yield "That is no better than a guess: what is said above of actions is not borne out by windows not seen."


def _smaller(score: float) -> str:
    how = "smaller" if score >= 0 else "larger"
    return f"squared errors are {percent(abs(score))} {how} (R² {number(score, 3)})"


def sure(result: LoggedCredit) -> Iterator[str]:
    """What an interval is, and what was resampled."""
    found = result.found
    units, level = found.units, percent(found.options.level)
    if units.enough:
        yield (
            f"Intervals are {level} intervals: the recovery was done again {found.options.draws} times, with "
            f"{len(units)} independent parts of the table weighed anew ({units.said})."
        )
        yield (
            "The interval of a row is one for its expected credit. What really happened in a single row may lie "
            "outside."
        )
    else:
        yield (
            f"There are no intervals: the table has {len(units)} independent part{'s' * (len(units) != 1)}, and with "
            f"fewer than ten an interval says more than is known ({units.said}). More windows, or more series, would "
            "give some."
        )


def causes(result: LoggedCredit) -> Iterator[str]:
    """Association or cause; what a placebo and something unmeasured say of it."""
    roles = result.found.panel.roles
    if not roles.actions:
        return
    loose = [name for name in roles.actions if name not in roles.randomised]
    if loose:
        yield (
            f"Numbers of {listed(loose)} are associations: they say what goes with the action, not what it causes. "
            "Whoever chose it may have done so when things were good anyway. Intervals are not valid where it was "
            "chosen by what had been seen before."
        )
    if roles.randomised:
        yield f"{listed(roles.randomised)} is said to be drawn at random, so that its numbers may be read as effects."
    yield from _placebo(result)
    yield from _robustness(result)


def _placebo(result: LoggedCredit) -> Iterator[str]:
    frame = result.placebo
    if not len(frame) or not result.found.units.enough:
        return
    guilty = [str(name) for name in frame.loc[frame["explains"].astype(bool), "action"]]
    if guilty:
        yield (
            f"Warning: the next window’s {listed(guilty)} “explains” this window’s label, which it cannot cause. "
            "Something else moves both, and the number above has some of it."
        )
    else:
        yield (
            f"A check that could have failed did not: the next window’s {listed(list(frame['action']))} does not "
            "“explain” this window’s label."
        )


def _robustness(result: LoggedCredit) -> Iterator[str]:
    frame = result.robustness.dropna(subset=["robustness"])
    if not len(frame):
        return
    lines = frame.sort_values("robustness", kind="stable").to_dict("records")
    weak, strong = lines[0], lines[-1]
    words = (
        f"To bring {named(strong)} to nothing, something unmeasured would have to explain "
        f"{percent(strong['robustness'])} of what is left of both the label and the action"
    )
    yield f"{words}; for {named(weak)}, {percent(weak['robustness'])} is enough." if len(lines) > 1 else f"{words}."


def missing(result: LoggedCredit) -> Iterator[str]:
    """Where labels are missing more often, or less, than elsewhere."""
    frame = result.labelled
    differs = frame[frame["differs"].astype(bool)]
    if not len(differs):
        return
    parts = [
        f"{short(line['column'])} {short(line['value'])} ({percent(line['labelled'])})"
        for line in differs.head(NAMED).to_dict("records")
    ]
    more = f", and {len(differs) - NAMED} more" if len(differs) > NAMED else ""
    yield f"Labels are no fair sample of all windows. The share that has one differs where: {'; '.join(parts)}{more}."


def differ(result: LoggedCredit) -> Iterator[str]:
    """What models are, and how much each counts."""
    if MIXTURE not in result.models:
        yield (
            f"There is one model, {short(result.models[0])}, so that nothing can disagree with it. Add surrogates "
            "for a second opinion."
        )
        return
    yield (
        f"{len(result.models) - 1} models were fitted. In each row they are mixed by how far each is likely to be off "
        "there, and where they differ the row’s credit depends on what one believes."
    )
    low, high = (float(np.quantile(result.rows.disagreement, share)) for share in (0.5, 0.99))
    yield (
        f"In half of the rows they differ by {number(low)} or less, in one of a hundred by more than {number(high)}; "
        f"a row’s credit is {number(float(result.rows.credit.mean()))} on average."
    )

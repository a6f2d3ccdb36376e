"""What a recovery says, in sentences for a reader who has never heard of a standard error."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from credit.logged.panel import INTERCEPT, MIXTURE
from credit.logged.report.gathered import Gathered
from credit.logged.report.names import NAMED, called, listed, named, numberless
from credit.logged.report.numbers import interval, number, percent, short
from credit.logged.trusting import warnings

if TYPE_CHECKING:
    from credit.logged.result import LoggedCredit

LABEL = {
    "sum": "the sum of what its rows brought",
    "mean": "the mean of what its rows brought",
    "last": "what its last row brought",
    "binary": "yes or no; the sum of its rows’ credit is the log-odds of yes",
}


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
    span = f", beginning with {short(roles.time)} {_whole_date(data.when[0])}" if roles.time else ""
    labelled = int(windows.labelled.sum())
    known = "Of each window" if labelled == len(windows) else f"Of {labelled:,} of these windows"
    return (
        f"The table has {panel.rows:,} rows{groups} in {len(windows):,} windows ({short(roles.window)}){span}. "
        f"{known} one thing is known, {short(roles.label)}: {LABEL[roles.label_is]}. This page says how much of it "
        "each row is expected to have brought: its credit."
    )


def _whole_date(words: str) -> str:
    """A time that no line breaks."""
    return short(words).replace("-", "\u2011")


def worth(result: LoggedCredit) -> str:
    """The largest effects in a sentence; a word on those that may be nothing."""
    lines = main_effects(result)
    if not lines:
        return "No column was named as an action, so that nothing is said of what actions were worth."
    if result.rate is not None:
        return (
            f"Labels are proportional to windows’ lengths, {number(result.rate)} a row: nothing is left for actions to "
            "explain, and no action made a difference."
        )
    told = [line for line in lines if not numberless(line)]
    sure = [line for line in told if _sure(line)]
    found = []
    judged = any(np.isfinite(line["total_low"]) for line in told)
    shown = (sure if judged else told)[:3]
    if shown:
        parts = [f"{named(line)} ({_total(result, line)})" for line in shown]
        found.append(f"The largest number{'s are those' if len(parts) > 1 else ' is that'} of {listed(parts, 3)}.")
    if judged and (none := [named(line) for line in told if not _sure(line)]):
        found.append(f"Of {listed(none)} it cannot be said whether it brought anything: the interval holds 0.")
    if untold := [named(line) for line in lines if not line["told"] and line["rows"]]:
        found.append(f"Of {listed(untold)} these windows tell nothing, and no number is given.")
    if shown and set(result.found.panel.roles.actions) - set(result.found.panel.roles.randomised):
        found.append("Such numbers say what goes with an action, not what it causes.")
    return " ".join(found)


def _sure(line: dict[Any, Any]) -> bool:
    return bool(line["total_low"] > 0 or line["total_high"] < 0)


def _total(result: LoggedCredit, line: dict[Any, Any]) -> str:
    key, unit = {"sum": ("total", ""), "binary": ("per_unit", " log-odds a unit")}.get(
        result.found.panel.roles.label_is, ("effect", " in an average row")
    )
    value, between = interval(*(line[f"{key}{end}"] for end in ("", "_low", "_high")))
    whole = _whole(result)
    share = (
        f", {percent(line['total'] / whole)} of all {short(result.found.panel.roles.label)}"
        if 0 < line["total"] <= whole
        else ""
    )
    return f"{value}{unit}{f', interval {between}' if between else ''}{share}"


def _whole(result: LoggedCredit) -> float:
    """What all rows are expected to bring; NaN where labels are no sums."""
    if result.found.panel.roles.label_is != "sum":
        return float("nan")
    return float(result.rows.credit.sum())


def predicts(result: LoggedCredit) -> Iterator[str]:
    """How well windows are predicted that were not seen, against two yardsticks."""
    found = result.found
    alike, last = result.r_squared[result.models[-1]]
    if result.rate is not None:
        yield "The guess that all rows are alike makes no error: nothing is left to explain."
        return
    if not np.isfinite(alike):
        yield "There are too few windows to hold some out: it is not known how well credit predicts."
        return
    yield (
        f"To find out, {len(found.folds.of)} stretches of time were left out, one after the other, with the windows "
        "around them, and predicted from the rest."
    )
    yield f"Against the guess that all rows are alike, {_smaller(alike)}."
    if np.isfinite(last):
        yield f"Against the guess that a row is worth what it was in the last window, {_smaller(last)}."


def _smaller(score: float) -> str:
    how = "smaller" if score >= 0 else "larger"
    return f"squared errors are {percent(abs(score))} {how} (R² {number(score, 3)})"


def sure(result: LoggedCredit) -> Iterator[str]:
    """What an interval is, and what was resampled."""
    found = result.found
    units, level = found.units, percent(found.options.level)
    if found.enough:
        yield (
            f"Intervals are {level} intervals: the recovery was done again {found.options.draws} times, with "
            f"{len(units)} parts of the table weighed anew, which are independent of each other as far as can be seen. "
            f"{_sentence(units.said)}"
        )
        yield (
            "The interval of a row is one for its expected credit. What really happened in a single row may lie "
            "outside."
        )
    elif units.enough:
        yield f"{_sentence(found.few_draws)} {_sentence(units.said)}"
    else:
        yield (
            "There are no intervals: with fewer than ten independent parts of the table they would say more than is "
            f"known. {_sentence(units.said)} More windows, or more series, would give some."
        )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def causes(result: LoggedCredit) -> Iterator[str]:
    """Association or cause; what a placebo and something unmeasured say of it."""
    roles = result.found.panel.roles
    if not roles.actions:
        return
    loose = [name for name in roles.actions if name not in roles.randomised]
    if loose:
        yield (
            f"Numbers of {listed(loose)} are associations: they say what goes with the action, not what it causes. "
            "It may have been chosen when things were good anyway. Intervals are not valid where it was chosen by what "
            "had been seen before."
        )
    if roles.randomised:
        yield (
            f"It was said that {listed(roles.randomised)} was drawn at random: numbers of it may be read as effects."
        )
    frame = result.placebo
    if len(frame) and result.found.enough and not _guilty(result):
        yield (
            f"A check that could have failed did not: the next window’s amount of {listed(list(frame['action']))} does "
            "not “explain” this window’s label."
        )
    yield from _robustness(result)


def warned(result: LoggedCredit) -> Iterator[str]:
    """What stands against the numbers of this recovery."""
    if guilty := _guilty(result):
        yield (
            f"The next window’s amount of {listed(guilty)} “explains” this window’s label, which it cannot cause. "
            "Something else may move both, and then the number above is not to be trusted. By chance alone about "
            f"{percent(1 - result.found.options.level)} of all tables say so."
        )
    if result.r_squared[result.models[-1]][0] <= 0:
        yield "Windows not seen are predicted no better than by a guess, which speaks against all numbers here."
    for one in warnings(result.found, result.judged):
        yield _sentence(one)
    yield from _missing(result)


def _guilty(result: LoggedCredit) -> list[str]:
    """Actions whose next amount "explains" a label."""
    return [str(name) for name in result.placebo.loc[result.placebo["explains"].astype(bool), "action"]]


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


def _missing(result: LoggedCredit) -> Iterator[str]:
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


def untold(result: LoggedCredit) -> Iterator[tuple[str, str]]:
    """What no label tells apart, and what would: columns of a design by the names of what they were made of."""
    rows = "1" if result.found.panel.roles.label_is in ("mean", "last") else "(number of rows)"
    for one in result.found.telling.relations:
        text = re.sub(r"\[T\.([^]]*)\]", r": \1", one.text)
        yield short(re.sub(rf"\b{INTERCEPT}\b", rows, text), 300), short(one.remedy, 400)


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
    if not result.rows.disagreement.any():
        yield "Here they say the same of every row."
        return
    reference, *others = result.found.names
    gaps = [
        f"{number(float(np.abs(one - result.rows.each[0]).mean()))} ({called(name)})"
        for name, one in zip(others, result.rows.each[1:], strict=True)
    ]
    yield (
        f"A row’s credit is {number(float(result.rows.credit.mean()))} on average. From what {called(reference)} says "
        f"of a row, the others are so far away on average: {listed(gaps)}. Rows, bars and tables below are in the "
        "order of how far models lie apart. Disagreement is another thing: how far the model that is best in a row may "
        "be off, its own spread or its distance from the reference. It is small where one model is sure, and there "
        "others count little, however far away they are."
    )

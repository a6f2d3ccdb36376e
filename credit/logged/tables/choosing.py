"""Which columns can be features, and which of these were done and not only there, by names and a sample of rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from credit.core.errors import UserError
from credit.logged.tables.clock import CALENDAR
from credit.logged.tables.columns import LEVELS, codes, odd_one
from credit.logged.tables.guesses import Sample, named, whole
from credit.logged.tables.words import BEHIND

ACTION = ("action", "spend", "spending", "budget", "bid", "price", "discount", "promo", "promotion", "coupon", "dose",
          "treatment", "treat", "tv", "radio", "print", "ooh", "billboard", "search", "social", "display", "email",
          "mail", "ads", "ad", "advertising", "campaign", "media", "facebook", "google", "youtube", "tiktok",
          "newsletter", "a", "impressions", "clicks")  # fmt: skip
STATE = ("state", "obs", "observation", "s", "temp", "temperature", "rain", "rainfall", "snow", "wind", "weather",
         "sun", "humidity", "stock", "inventory", "holiday", "season", "trend", "income", "age", "gdp", "unemployment",
         "competitor", *CALENDAR)  # fmt: skip
LEAK = ("reward", "rewards", "r", "credit", "propensity", "pscore")
COUNTER = ("unnamed", "index", "id", "row", "rownum", "uuid", "key")
EPISODE = ("episode", "trajectory", "traj", "rollout")
END = ("terminated", "truncated", "terminal", "terminals", "timeout", "timeouts", "done", "dones", "is_last")


def features(sample: Sample, names: Sequence[str], label: str | None) -> tuple[list[str], list[str]]:
    """Columns that can be features, and a sentence about each that is left out.

    Raises:
        UserError: a column of numbers and words.
    """
    kept, said = [], []
    for name in names:
        reason = _unfit(sample, name, label)
        if reason:
            said.append(f"{name} is left out: {reason}")
        else:
            kept.append(name)
    return kept, said


def _unfit(sample: Sample, name: str, label: str | None) -> str | None:
    values, what = sample.frame[name], sample.kinds[name]
    if what == "empty":
        return "it has no values"
    if what == "other":
        return "it holds neither numbers nor words"
    if name.startswith(BEHIND):
        return "by its name it came behind the step"
    if named(name, LEAK) is not None:
        return "by its name it tells what is looked for, or how it was drawn"
    if name.lower() in END:
        return "by its name it says where an episode ended"
    if name.lower() in EPISODE:
        return "by its name it numbers episodes"
    if sample.dated(name):
        return "it holds dates (data.calendar=[weekday, month] makes features of them)"
    levels = sample.levels(name)
    if levels == 1:
        return "it has one value"
    if what == "category":
        found, some = codes(values)
        counts = dict(zip(some.tolist(), np.bincount(found[found >= 0], minlength=len(some)).tolist(), strict=True))
        odd = odd_one(counts)
        if odd is not None:
            row = int((values == odd).to_numpy().argmax())
            where = f" (row {row} of those looked at)"
            raise UserError(
                f"{sample.source}: {name} has {odd!r}{where} among other kinds of values; mend it, or leave it empty"
            )
        return f"it has {levels} different words (at most {LEVELS})" if levels > LEVELS else None
    some = np.asarray(values, dtype=np.float64)
    steps = np.unique(np.diff(some))
    if named(name, COUNTER) is not None and (levels == len(sample) or whole(values)):
        return "by its name it only numbers rows"
    if len(some) > 2 and len(steps) == 1 and steps[0] != 0:
        return "it only counts the rows"
    if label in sample.frame.columns and name != label:
        import pandas as pd

        truth = pd.to_numeric(sample.frame[label], errors="coerce").to_numpy(np.float64, na_value=np.nan)
        if np.array_equal(some, truth, equal_nan=True):
            return f"it equals {label}, the label"
    return None


def actions(sample: Sample, names: Sequence[str]) -> tuple[list[str], str]:
    """Which features were done and not only there, and why it is thought so."""
    called = [name for name in names if named(name, ACTION) is not None and named(name, STATE) is None]
    if called:
        return called, "by their names"
    likely = [name for name in names if named(name, STATE) is None and sample.kinds[name] == "number"]
    bursts = []
    for name in likely:
        values = np.asarray(sample.frame[name], dtype=np.float64)
        if np.nanmin(values) >= 0 and np.mean(values == 0) >= 0.2 and sample.levels(name) > 2:
            bursts.append(name)
    if bursts:
        return bursts, "never negative, and often 0"
    rest = [name for name in names if named(name, STATE) is None]
    return (rest or [*names]), "nothing tells what was done from what was there"

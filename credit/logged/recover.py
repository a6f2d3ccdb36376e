"""`credit.recover`: per-step credit from a table, from Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from credit.core.errors import UserError, nearest
from credit.logged.asking import Ask
from credit.logged.recovered import Options
from credit.logged.tables.opening import opened
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    from credit.core.seams import Mixer
    from credit.logged.result import LoggedCredit

Formula = str | Mapping[str, Any] | Any  # or a RewardModel


def recover(
    data: Any,
    *,
    reference: Formula | None = None,
    surrogates: Mapping[str, Formula] | None = None,
    mixer: Mixer | None = None,
    **words: Any,
) -> LoggedCredit:
    """A reward for every row of a table, from labels on windows of rows, with intervals.

    Args:
        data: a pandas frame; a CSV or Parquet file, a folder, a pattern; or a Minari dataset. reference: the flexible
            model's formula, or a mapping of formula, regularization and sign, or a `RewardModel`; None: all columns.
        surrogates: name → the same; None: actions alone; {}: none. mixer: of the models; None: relative MSE.
        words: what the columns are (window, label, time, group, states, actions, label_is, …), guessed where it is not
            said, and how (draws, level, folds, gap, residual, rho, nonnegative, seed), as `credit recover --help` lists
            them.

    Returns:
        Frames `steps`, `windows`, `effects`, `told`, and what is to be said of them.

    Raises:
        UserError: with what is wrong with the table or the words.

    Example:
        >>> found = credit.recover(frame, window="week", label="sales", actions=["tv", "radio"])
        >>> found.steps[["credit", "credit_low", "credit_high", "credit_balanced"]]
    """
    from credit.logged.result import LoggedCredit

    options = [one.name for one in fields(Options)]
    roles = [one.name for one in fields(Words)]
    if wrong := [name for name in words if name not in (*options, *roles)]:
        raise UserError(f"recover has no word {wrong[0]!r}; {nearest(wrong[0], [*roles, *options])}")
    given = {name: value for name, value in words.items() if name in options}
    ask = Ask.of({"reference": reference, "surrogates": surrogates, **given}, mixer)
    panel = opened(data, {name: value for name, value in words.items() if name in roles})
    found = LoggedCredit.of(ask.fit(panel))
    found.index = getattr(data, "index", None) if hasattr(data, "columns") else None
    return found

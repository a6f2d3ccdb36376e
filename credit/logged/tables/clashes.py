"""Columns of a table that are called as columns of what a recovery writes, and would take their places."""

from __future__ import annotations

from collections.abc import Iterable

from credit.core.errors import UserError
from credit.logged.panel import Roles

STEPS = ("row", "credit", "credit_low", "credit_high", "credit_balanced", "disagreement")
WINDOWS = ("steps", "label", "predicted", "held_out", "residual", "fold", "told")


def require_apart(roles: Roles, models: Iterable[str], source: str) -> None:
    """Refuse names of columns that results have, too.

    Args:
        roles: of the table; its window, time and group are in the results. models: their names, of which there are
            columns `credit_…` and `weight_…`.

    Raises:
        UserError: with the first.
    """
    steps = {*STEPS, *(f"{what}_{name}" for name in models for what in ("credit", "weight"))}
    for word, taken, where in (
        ("window", steps, "steps"), ("time", steps, "steps"), ("group", steps, "steps"),
        ("window", {*WINDOWS}, "windows"), ("group", {*WINDOWS}, "windows"),
    ):  # fmt: skip
        if (name := getattr(roles, word)) in taken:
            raise UserError(
                f"{source}: the column {name!r} (data.{word}) is called as one of the results (in {where}), and both "
                f"would be there; rename it (in pandas: rename(columns={{{name!r}: 'my_{name}'}}))"
            )

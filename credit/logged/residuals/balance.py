"""Credit that adds up to its window's label: what is left of the label is given to steps, to the last digit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from credit.core.compiled import Loop
from credit.core.errors import UserError
from credit.logged.panel import Floats, Ints, LabelIs

NAMED = 3  # windows that a message names


def balanced(
    credit: Floats,
    label: Floats,
    steps: Ints,
    label_is: LabelIs = "sum",
    *,
    errors: Floats | None = None,
    nonnegative: bool = False,
    ids: Sequence[Any] | None = None,
) -> Floats:
    """Credit [n] whose windows have their labels: Σ, mean or last row.

    Without errors each row of a window gets the same (the last one all, where labels are of it): that is the nearest
    credit which adds up. What errors leave by rounding goes the same way. Without a label nothing has to add up.

    Args:
        credit: of each row [n], the rows of each window together. label: Y, NaN for none [W]. steps: rows of each [W].
        label_is: sum, mean or last. errors: E[u] of each row, as `residuals.errors` has them. nonnegative: the nearest
            credit of which no row is below 0. ids: windows' names, for messages [W].

    Raises:
        UserError: a label below 0 that no credit above 0 can add up to, or labels that are bits.
    """
    if label_is == "binary":
        raise UserError(
            "credit_balanced: labels are bits (data.label_is=binary), which log-odds of steps do not add up to; "
            "allowed: data.label_is=sum, mean, last"
        )
    out = np.array(credit, dtype=np.float64) if errors is None else credit + errors
    label = np.ascontiguousarray(label, dtype=np.float64)
    total = label * steps if label_is == "mean" else label
    last = label_is == "last"
    settle(out, total, steps, last)
    if nonnegative:
        _refuse_negative(label, ids)
        project(out, total, steps, last)
    return out


def _refuse_negative(label: Floats, ids: Sequence[Any] | None) -> None:
    below = np.flatnonzero(label < 0)
    if not len(below):
        return
    names = ", ".join(f"{w if ids is None else ids[w]} ({label[w]:g})" for w in below[:NAMED])
    more = f" and {len(below) - NAMED} more" if len(below) > NAMED else ""
    raise UserError(
        f"nonnegative: {len(below)} of {len(label)} windows have a label below 0, which steps of at least 0 cannot add "
        f"up to: {names}{more}. Use nonnegative=false, correct these labels, or leave them empty"
    )


@Loop
def settle(credit: Floats, total: Floats, steps: Ints, last: bool) -> None:
    """Add to rows [n], in place, what their windows' totals [W] have more than they; NaN is no total.

    Sums carry what rounding loses (Neumaier 1974), and it is done twice: the first round is itself rounded.
    """
    begin = 0
    for w in range(len(steps)):
        end = begin + steps[w]
        if not np.isnan(total[w]):
            if last:
                credit[end - 1] = total[w]
            else:
                for _ in range(2):
                    s, lost = -total[w], 0.0
                    for t in range(begin, end):
                        new = s + credit[t]
                        lost += (s - new) + credit[t] if abs(s) >= abs(credit[t]) else (credit[t] - new) + s
                        s = new
                    share = (s + lost) / steps[w]
                    if share == 0.0:
                        break
                    for t in range(begin, end):
                        credit[t] -= share
        begin = end


@Loop
def project(credit: Floats, total: Floats, steps: Ints, last: bool) -> None:
    """The nearest rows [n], in place, that are at least 0 and have their windows' totals [W] ≥ 0 (Michelot 1986).

    Rows above a threshold are lowered by it, all others are 0. The threshold rises: rows below the one at which all
    share what is too much leave, and the others share anew. Without a total, what is below 0 becomes 0.
    """
    begin = 0
    for w in range(len(steps)):
        end = begin + steps[w]
        if last or np.isnan(total[w]):
            for t in range(begin, end):
                credit[t] = max(credit[t], 0.0)
        else:
            low, kept = -np.inf, -1
            while True:
                s, count = 0.0, 0
                for t in range(begin, end):
                    if credit[t] > low:
                        s += credit[t]
                        count += 1
                if count == kept or count == 0:
                    break
                low, kept = max(low, (s - total[w]) / count), count
            rest, largest = total[w], begin
            for t in range(begin, end):
                if credit[t] > credit[largest]:
                    largest = t
            for t in range(begin, end):
                if t != largest:
                    credit[t] = max(credit[t] - low, 0.0)
                    rest -= credit[t]
            credit[largest] = max(rest, 0.0)
        begin = end

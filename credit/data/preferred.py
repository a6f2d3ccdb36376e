"""Which windows an agent would rather learn from: successes where labels are bits, the best of any others."""

from __future__ import annotations

from typing import Literal

from torch import Tensor

from credit.core.errors import UserError

Prefer = Literal["none", "success", "top"]
TOP = 0.9  # quantile of a replica's labels from which on a window is among its best


def preferred(labels: Tensor, prefer: Prefer) -> Tensor:
    """Which windows are preferred, by their labels [R, K].

    Raises:
        UserError: `success` of labels that are no bits.
    """
    if prefer == "top":
        return labels >= labels.quantile(TOP, dim=1, keepdim=True)
    strange = labels[(labels != 0) & (labels != 1)]
    if len(strange):
        raise UserError(
            f"agent.prefer=success: a label says 1 for success and 0 for none, and here is one of "
            f"{float(strange[0]):.6g}; choose agent.prefer=top for the best tenth of all labels, or none"
        )
    return labels > 0

"""Which windows an agent would rather learn from: successes where labels are bits, the best of any others."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import LabelKind

Prefer = Literal["none", "success", "top"]
TOP = 0.9  # quantile of a replica's labels from which on a window is among its best
INSTEAD = "choose agent.prefer=top for the best tenth of all labels, or none"


def require_bits(prefer: Prefer, labels: LabelKind | None) -> None:
    """Refuse to prefer successes where labels are declared to be no bits.

    Raises:
        UserError: they are.
    """
    if prefer == "success" and labels == "real":
        raise UserError(
            f"agent.prefer=success: this feedback's labels are real numbers, and a success is a bit; {INSTEAD} (a "
            "feedback of your own whose labels are 0 and 1 says kind = 'bits')"
        )


def preferred(labels: Tensor, prefer: Prefer, labelled: Tensor | None = None) -> Tensor:
    """Which windows are preferred, by their labels [R, K]; none that has no label.

    Raises:
        UserError: `success` of labels that are no bits.
    """
    if labelled is not None:
        labels = torch.where(labelled, labels, torch.nan if prefer == "top" else 0)
    if prefer == "top":
        return labels >= labels.nanquantile(TOP, dim=1, keepdim=True)
    strange = labels[(labels != 0) & (labels != 1)]
    if len(strange):
        raise UserError(
            f"agent.prefer=success: a label says 1 for success and 0 for none, and here is one of "
            f"{float(strange[0]):.6g}; {INSTEAD}"
        )
    return labels > 0

"""What is left of labels when windows' sums are explained, as an autoregression of steps: whitened, and given to steps.

u_t = ρ u_{t−1} + ε_t within a group, stationary, the variance of ε being σ² (Chow and Lin 1971). A label has the sum of
its window's u, their mean or the last one; a window without a label is a gap which u goes through. All is exact and
takes O(W) or O(n): the state of a Kalman filter is u in the last row, since a window's sum begins anew in every window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.panel import Floats, Ints, LabelIs
from credit.logged.residuals import loops

EVERY = slice(None)


@dataclass(frozen=True)
class Layout:
    """How windows lie: what does not depend on ρ.

    Attributes:
        steps: rows [W]. labelled: which have a label [W]. first: whether a group begins with it [W]. lengths: numbers
            of rows that occur, ascending [U]. kind: which of them each window has [W]. times: by what a label is
            multiplied to be a sum [W]. last: whether a label is of the last row.
    """

    steps: Ints
    labelled: NDArray[np.bool_]
    first: NDArray[np.bool_]
    lengths: Ints
    kind: Ints
    times: Floats
    last: bool

    @classmethod
    def of(cls, steps: Ints, group: Ints, labelled: NDArray[np.bool_], label_is: LabelIs = "sum") -> Layout:
        """Of windows in the order of groups and time.

        Args:
            steps: rows of each [W]. group: number of its group [W]. labelled: [W]. label_is: sum, mean or last.

        Raises:
            UserError: of labels that are bits, which have no residual that steps could share.
        """
        if label_is == "binary":
            raise UserError(
                "residual: labels are bits (data.label_is=binary), and what is left of a bit cannot be given to steps; "
                "allowed: data.label_is=sum, mean, last. Use credit as it is, without credit_balanced"
            )
        lengths, kind = np.unique(steps, return_inverse=True)
        first = np.diff(group, prepend=group[:1] - 1) != 0
        times = steps.astype(np.float64) if label_is == "mean" else np.ones(len(steps))
        return cls(steps, labelled, first, lengths, kind.astype(np.int64), times, label_is == "last")

    def __len__(self) -> int:
        """W."""
        return len(self.steps)


class Whitened(NamedTuple):
    """L⁻¹ of windows' values, where σ² V = σ² L Lᵀ is the covariance of their errors.

    Attributes:
        values: [W, k], zeros where a window has no label. logdet: log |V| of the labelled windows.
    """

    values: Floats
    logdet: float


def whiten(values: Floats, layout: Layout, rho: float, out: Floats | None = None) -> Whitened:
    """What generalised least squares needs of labels and window sums: their rows uncorrelated, with variance σ².

    Args:
        values: of windows as labels are (of mean labels: means) [W, k]; what unlabelled windows have is not read.
        layout: how windows lie. rho: −1 < ρ < 1. out: where to write; it may be `values`.
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    out = np.empty_like(values) if out is None else out
    table, gain, scale, logdet = _gains(layout, rho)
    loops.innovations(values, layout.kind, layout.first, layout.times, table, gain, scale, rho, out)
    if logdet and (layout.times != 1).any():
        logdet -= 2 * float(np.log(layout.times[layout.labelled]).sum())
    return Whitened(out, logdet)


@dataclass(frozen=True)
class Errors:
    """The expected u of every row, given what is left of all labels, in the few numbers of a window that say it.

    Steps of a window depend on others through these alone, so that they are unfolded part by part.

    Attributes:
        layout: how windows lie. rho: ρ. before: expected u of the row before the first [W]. pull: V⁻¹ of what is left
            (sums), 0 for none [W]. after: expected ε of the row after the last, 0 at a group's end [W].
    """

    layout: Layout
    rho: float
    before: Floats
    pull: Floats
    after: Floats

    def rows(self, windows: slice = EVERY) -> Floats:
        """u of the rows of some windows that follow each other [n]."""
        steps = np.ascontiguousarray(self.layout.steps[windows])
        out = np.empty(int(steps.sum()))
        before, pull, after = (np.ascontiguousarray(each[windows]) for each in (self.before, self.pull, self.after))
        loops.unfolded(steps, before, pull, after, self.rho, self.layout.last, out)
        return out


def errors(residual: Floats, layout: Layout, rho: float) -> Errors:
    """E[u | what is left of labels], for the rows of all windows, with and without a label.

    Args:
        residual: Y − x θ, as labels are [W]; NaN where there is no label. layout: how windows lie. rho: −1 < ρ < 1.
    """
    table, gain, scale, _ = _gains(layout, rho)
    whitened = np.empty((len(layout), 1))
    left = np.ascontiguousarray(residual, dtype=np.float64)[:, None]
    loops.innovations(left, layout.kind, layout.first, layout.times, table, gain, scale, rho, whitened)
    before, pull, after = (np.empty(len(layout)) for _ in range(3))
    loops.smoothed(whitened[:, 0], layout.kind, layout.first, table, gain, scale, rho, before, pull, after)
    return Errors(layout, rho, before, pull, after)


def _gains(layout: Layout, rho: float) -> tuple[Floats, Floats, Floats, float]:
    """Table of lengths [U, 5], gains [W], 1 / deviation of what is new in a label [W] (0 for none), and log |V|."""
    if not -1 < rho < 1:
        raise UserError(f"rho: {rho} is no correlation of a stationary series; allowed: above −1 and below 1")
    table = np.empty((len(layout.lengths), 5))
    loops.table_of(layout.lengths, rho, layout.last, table)
    gain, scale = np.empty(len(layout)), np.empty(len(layout))
    logdet = loops.gains(layout.kind, layout.first, layout.labelled, table, rho, gain, scale)
    return table, gain, scale, float(logdet)

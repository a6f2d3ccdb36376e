"""A table whose rows were scored by models that have not seen them, as frames."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from credit.logged.fits.folds import r_squared
from credit.logged.fitted import Fitted
from credit.logged.panel import Floats, Panel
from credit.logged.scoring import Scored, frames, in_order, shares, windowed_frame

if TYPE_CHECKING:
    import pandas as pd

CARRIES = ("lag(", "adstock(")


class ScoredTable:
    """Credit of every row of a table by models that were fitted to another one.

    Attributes:
        panel: the table. fitted: models. rows: credit of all rows. sums: what credit adds up to in each window, as
            labels do [W]. told: whether the labels that were fitted tell it [W]. predicted: the same, NaN where they
            do not [W].

    Args:
        rate: what a label tells of a row where all are alike, in the table that was fitted.
    """

    def __init__(self, panel: Panel, fitted: Fitted, rows: Scored, sums: Floats, told: np.ndarray, rate: float) -> None:
        self.panel, self.fitted, self.rows, self.told, self.sums = panel, fitted, rows, told, sums
        self.predicted = np.where(told, sums, np.nan)
        self._rate = rate

    @cached_property
    def steps(self) -> pd.DataFrame:
        """A row of what was given each, in that order, as in the steps of a recovery."""
        return in_order(frames(self.panel, self.fitted.names, self.rows))

    @cached_property
    def windows(self) -> pd.DataFrame | None:
        """A row a window: label, prediction, residual, and whether it is told; None where rows have no windows."""
        if not self.panel.roles.window:
            return None
        label = self.panel.windows.label
        frame = windowed_frame(self.panel)
        return frame.assign(predicted=self.predicted, residual=label - self.predicted, told=self.told)

    @property
    def r_squared(self) -> float:
        """Of the labels, against all steps alike as they were in the table that was fitted; NaN without labels."""
        return r_squared(self.panel.windows.label, self.predicted, self._rate * shares(self.panel))

    @property
    def metrics(self) -> dict[str, float]:
        """Numbers for a run."""
        windows = self.panel.windows
        found: dict[str, float] = {"rows": self.panel.rows}
        if self.panel.roles.window:
            found |= {"windows": len(windows), "labelled": int(windows.labelled.sum())}
        return found | {"r2": self.r_squared}

    @property
    def said(self) -> tuple[str, ...]:
        """What is to be known of it, a sentence each."""
        found = [*self.panel.said]
        if self._looks_back():
            where = f"each {self.panel.roles.group}" if self.panel.roles.group else "the table"
            found.append(f"lag and adstock begin anew with the first row of {where}; rows before it are not known")
        if self.panel.roles.window and not self.told.all():
            found.append(
                f"labels of {int((~self.told).sum())} windows are not predicted: the labels that were fitted do not "
                "tell columns apart that differ there"
            )
        return tuple(found)

    def _looks_back(self) -> bool:
        """Whether a term that is used carries something from row to row."""
        used = {one.model.terms.names[at] for one in self.fitted.parts for at in one.columns}
        return any(word in name for name in used for word in CARRIES)

    def __repr__(self) -> str:
        return f"ScoredTable({self.panel.rows} rows, {'+'.join(self.fitted.names)}, R² {self.r_squared:.3f})"

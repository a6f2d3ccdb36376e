"""A table of steps with labels on windows, as every part of this room sees it.

Rows lie in the order of groups and, within a group, of time; every window's rows follow each other. Tables that are
larger than memory are seen in parts, each of whole windows, in that order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

    from credit.logged.tables.known import Known

INTERCEPT = "Intercept"  # name of a design's column that is 1 in every row, as formulaic has it
NOTHING = 1e-12  # of a size, below which a number is what rounding left
MIXTURE = "mixture"  # what the models together are called in tables
LabelIs = Literal["sum", "mean", "last", "binary"]
LABEL_IS: Mapping[LabelIs, str] = {  # in words
    "sum": "the sum of a window's rows",
    "mean": "the mean of a window's rows",
    "last": "what the last of a window's rows brought",
    "binary": "0 or 1, with the sum of a window's rows as log-odds",
}
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Roles:
    """Which column is what.

    Attributes:
        window: names the rows that share a label; "": each row is one, where rows are scored that have none.
        label: of a window; "": there is none. time: of rows in a group; None: as they lie.
        group: series that have nothing to carry over to each other; None: one series.
        states: what was there. actions: what was done. Both are features; actions alone have effects.
        stock: features that are levels, not flows: a window has their mean, not their sum.
        label_is: of the rewards of a window's rows: their sum, mean or last, or a bit with their sum as log-odds.
        baseline: action → a₀, what an effect is counted from: 0 for numbers, the most frequent of categories.
        cost: action → column with what it cost in each row. randomised: actions that were drawn at random.
        propensity: column with the probability of the action that was taken.
        sizes: feature that is a whole number, 0 … n − 1 → n. next_states: columns with the states behind each step, in
            the order of `states`; none where nobody says them.
    """

    window: str
    label: str
    time: str | None = None
    group: str | None = None
    states: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    stock: tuple[str, ...] = ()
    label_is: LabelIs = "sum"
    baseline: Mapping[str, Any] = field(default_factory=dict)
    cost: Mapping[str, str] = field(default_factory=dict)
    randomised: tuple[str, ...] = ()
    propensity: str | None = None
    sizes: Mapping[str, int] = field(default_factory=dict)
    next_states: tuple[str, ...] = ()

    @property
    def features(self) -> tuple[str, ...]:
        """Actions and states."""
        return (*self.actions, *self.states)


@dataclass(frozen=True)
class Column:
    """What all rows say of a feature.

    Attributes:
        name: of the column. levels: of a category, in order; None for a number. stock: whether it is a level.
        mean, deviation, least, most: of a number, over all rows. quantiles: 0, 1/20, …, 1 of it, [21].
        frequent: the most frequent level of a category.
    """

    name: str
    levels: tuple[Any, ...] | None = None
    stock: bool = False
    mean: float = 0.0
    deviation: float = 0.0
    least: float = 0.0
    most: float = 0.0
    quantiles: tuple[float, ...] = ()
    frequent: Any = None

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, texts and numbers, from which `from_dict` makes it."""
        found: dict[str, Any] = plain(asdict(self))
        return found

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Column:
        """What was saved; levels that JSON does not know are texts now."""
        levels, quantiles = saved.get("levels"), saved.get("quantiles", ())
        return cls(**{**saved, "levels": levels and tuple(levels), "quantiles": tuple(quantiles)})


@dataclass(frozen=True)
class Windows:
    """One row a window, W of them, in the order of the rows.

    Attributes:
        id: what the window is called, [W] objects. group: number of its group [W]. groups: their names, in order.
        time: rank of the time at which it begins, among those of all groups [W]: windows that begin together have the
            same; where there is no time, its number in its group. steps: rows [W]. label: Y [W], NaN for none.
        key: a number that belongs to the window's name and group alone [W] uint64, whatever rows lie around it.
    """

    id: NDArray[Any]
    group: Ints
    groups: tuple[Any, ...]
    time: Ints
    steps: Ints
    label: Floats
    key: NDArray[np.uint64]

    def __len__(self) -> int:
        """W."""
        return len(self.label)

    @property
    def labelled(self) -> NDArray[np.bool_]:
        """Which have a label [W]."""
        return np.isfinite(self.label)

    @property
    def rate(self) -> float | None:
        """What every label is of its window's number of rows, where that is the same for all; else None."""
        label, steps = self.label[self.labelled], self.steps[self.labelled].astype(np.float64)
        if not len(label):
            return None
        rate = float(label.sum() / steps.sum())
        return rate if (np.abs(label - rate * steps) <= NOTHING * np.abs(label).max()).all() else None


@dataclass(frozen=True)
class Part:
    """Some rows, of whole windows.

    Attributes:
        frame: n rows: features (float64, or pandas categories with all levels of the data), roles' other columns as
            they were; its index is the row's number in what was given. window: number of each row's window [n].
        group: number of each row's group [n]. continues: whether the first row's group went on from the part before.
    """

    frame: pd.DataFrame
    window: Ints
    group: Ints
    continues: bool = False

    def __len__(self) -> int:
        """n."""
        return len(self.window)

    @property
    def starts(self) -> Ints:
        """The first row of each window in this part, ascending."""
        return np.flatnonzero(np.diff(self.window, prepend=self.window[0] - 1)).astype(np.int64)

    def sums(self, values: Floats) -> Floats:
        """Σ over the rows of each window [w, ...] of values [n, ...]."""
        return np.add.reduceat(values, self.starts, axis=0)


class Panel(ABC):
    """An opened table: checked, ordered, and read in parts.

    Attributes:
        source: where it comes from, for messages. roles: what its columns are. columns: features by name.
        windows: one row a window. rows: how many. said: what was guessed, or done to it, a sentence each.
        known: how it was read, so that another table can be read in the same way.
    """

    source: str
    roles: Roles
    columns: Mapping[str, Column]
    windows: Windows
    rows: int
    said: tuple[str, ...]
    known: Known

    first: int = 0  # number of the first window among those of the table of which this is a section

    @abstractmethod
    def parts(self) -> Iterator[Part]:
        """All rows, in order."""

    def sections(self) -> list[Panel]:
        """The same as panels of some windows each, which have nothing to carry over to each other; one of all."""
        return [self]


def plain(value: Any) -> Any:
    """What JSON knows; anything else as text."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    value = value.item() if isinstance(value, np.generic) else value
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)

"""What is resampled as one, so that an interval means what it says: groups, or blocks of time common to all groups.

A draw gives every unit u a weight of mean and variance 1 (an exponential one: Rubin's Bayesian bootstrap), from the
unit's name, the seed and the draw alone: shards, order and cores change nothing. With U units a draw's spread is
smaller than that of what is estimated by the factor √((U − 1) / (U + 1)) (Dirichlet weights against a sample's
variance), which is put right, and an interval takes Student's t with U − 1 degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from credit.logged.panel import Floats, Ints, Windows

FEWEST = 10  # independent units, below which there is no interval
GROUPS = 20  # from which on groups may be the units
SURE = 2.0  # standard errors from which on a correlation is there
GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True)
class Units:
    """What is resampled.

    Attributes:
        kind: groups or blocks. of: the unit of each window [W]. key: name of each unit, a number [U] uint64.
        length: times in a block. in_time, across: correlation of residuals of windows that follow each other, and of
            groups at one time; NaN where there is nothing to tell it. said: what was chosen and why, a sentence.
    """

    kind: str
    of: Ints
    key: NDArray[np.uint64]
    length: int
    in_time: float
    across: float
    said: str

    def __len__(self) -> int:
        """U."""
        return len(self.key)

    @property
    def enough(self) -> bool:
        """Whether there are intervals."""
        return len(self) >= FEWEST

    def weights(self, units: Ints, draws: int, seed: int) -> Floats:
        """How much units [u] count in the fit of all and in each draw [u, 1 + B]: first 1, then exponential numbers."""
        found = np.ones((len(units), 1 + draws))
        found[:, 1:] = exponential(self.key[units], draws, seed)
        return found

    @property
    def correction(self) -> float:
        """By what the spread of draws is multiplied."""
        count = len(self)
        return float(np.sqrt((count + 1) / (count - 1))) if count > 1 else float("nan")

    def quantile(self, level: float) -> float:
        """Half the width of an interval, in standard errors; NaN where there is none."""
        from scipy.special import stdtrit  # not scipy.stats, which takes a second to import

        return float(stdtrit(len(self) - 1, (1 + level) / 2)) if self.enough else float("nan")


def exponential(keys: NDArray[np.uint64], draws: int, seed: int) -> Floats:
    """Exponential numbers [u, B] that follow from key, seed and draw alone (splitmix64, a counter-based generator)."""
    start = _mixed(keys + GOLDEN * _mixed(np.array([seed], dtype=np.uint64) + GOLDEN))
    state = start[:, None] + GOLDEN * np.arange(1, draws + 1, dtype=np.uint64)
    uniform = ((_mixed(state) >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    return -np.log(uniform)


def _mixed(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


def correlations(residuals: Floats, windows: Windows) -> tuple[float, float, float, float]:
    """Of residuals [W], NaN where there is none: that of windows that follow each other in a group, and that of groups
    at one time, each with its standard error where there is none (NaN where there is nothing to tell it from)."""
    known = np.isfinite(residuals)
    centred = np.where(known, residuals - residuals[known].mean(), 0.0) if known.any() else np.zeros(len(residuals))
    variance = (centred**2).sum() / max(known.sum(), 1)
    if variance == 0:
        return 0.0, 0.0, float("nan"), float("nan")
    follows = (np.diff(windows.group) == 0) & known[1:] & known[:-1]
    pairs = int(follows.sum())
    along = (centred[1:] * centred[:-1])[follows].sum() / pairs / variance if pairs else float("nan")
    times = windows.time.max() + 1
    total, square, count = (np.bincount(windows.time, weights=w, minlength=times) for w in (centred, centred**2, known))
    both = float((count * (count - 1)).sum())
    across = float((total**2 - square).sum()) / both / variance if both else float("nan")
    # Each is a mean of products; they hang together themselves as the square of the other correlation does.
    along, squared = float(along), min(along**2, 0.99) if pairs else 0.0
    alike = 1 + (len(windows.groups) - 1) * across**2 if both else 1.0
    along_error = float(np.sqrt(alike / pairs)) if pairs else float("nan")
    across_error = float(np.sqrt(2 / both * (1 + squared) / (1 - squared))) if both else float("nan")
    return along, across, along_error, across_error


def block_length(correlation: float, times: int) -> int:
    """How many times make a block (Politis and White 2004, the rule for a first-order autoregression).

    (2 g² / D)^⅓ T^⅓ with g = Σ_k |k| ρ^|k| and D = 4/3 (Σ_k ρ^|k|)²; but at least ten blocks are left.

    Args:
        correlation: ρ of what follows each other. times: T.
    """
    rho = min(max(correlation, 0.0), 0.97)
    g, whole = 2 * rho / (1 - rho) ** 2, (1 + rho) / (1 - rho)
    best = (2 * g**2 / (4 / 3 * whole**2)) ** (1 / 3) * times ** (1 / 3)
    return int(max(1, min(np.ceil(best), times // FEWEST)))


def units_of(residuals: Floats, windows: Windows, whitened: bool = False) -> Units:
    """Choose what is resampled, from how the residuals of labels hang together.

    Args:
        residuals: of the fit to all labels [W], NaN where a window has none. whitened: whether what lasts from row to
            row was taken out of them, so that they hang together less than labels do.
    """
    taken = "once what lasts from row to row is taken out, " if whitened else ""
    along, across, along_error, across_error = correlations(residuals, windows)
    groups = np.unique(windows.group[np.isfinite(residuals)])
    together = np.isfinite(across) and across > SURE * across_error
    if len(groups) >= GROUPS and not together:
        keys = np.zeros(len(windows.groups), dtype=np.uint64)
        first = np.unique(windows.group, return_index=True)
        keys[first[0]] = _names(windows.groups)[first[0]]
        said = (
            f"groups are resampled: there are {len(groups)}, and {taken}their residuals at one time are not correlated"
        )
        return Units("groups", windows.group, keys, 0, along, across, f"{said} ({_number(across)})")
    times = int(windows.time.max()) + 1
    length = block_length(along if along > SURE * along_error else 0.0, times)
    of = windows.time // length
    keys = _mixed(np.arange(int(of.max()) + 1, dtype=np.uint64) + np.uint64(1))
    what = f"blocks of {length} windows" if length > 1 else "windows"
    common = " that begin together, of all groups," if len(windows.groups) > 1 else ""
    why = f"{taken}correlation of windows that follow each other {_number(along)}"
    why += f", of groups at one time {_number(across)}" if len(windows.groups) > 1 else ""
    said = f"{what}{common} are resampled, {len(keys)} of them ({why})"
    if len(keys) < FEWEST:
        said += f"; there are no intervals: they need {FEWEST} units that are independent of each other"
    return Units("blocks", of.astype(np.int64), keys, length, along, across, said)


def _names(groups: tuple[object, ...]) -> NDArray[np.uint64]:
    import pandas as pd

    return np.asarray(pd.util.hash_array(np.array([str(name) for name in groups], dtype=object)), dtype=np.uint64)


def _number(value: float) -> str:
    return "unknown" if not np.isfinite(value) else f"{value:.2f}"

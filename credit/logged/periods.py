"""Times that are seen together, so that a table over time has a few lines however many rows there are."""

from __future__ import annotations

import numpy as np

from credit.logged.panel import Ints, Windows

MOST = 160  # periods


def periods(windows: Windows, most: int = MOST) -> Ints:
    """The number of each window's period [W], 0, 1, …: windows that begin together, and their neighbours where there
    are more than `most` beginnings."""
    beginnings, place = np.unique(windows.time, return_inverse=True)
    return (place // max(-(-len(beginnings) // most), 1)).astype(np.int64)

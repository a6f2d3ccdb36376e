"""Columns of numbers that are others in another unit: what one of them does, no window tells from what the other does.

Where each has a decay of its own the tie is hidden from the windows' sums, and is to be seen in the rows alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from credit.logged.tables.guesses import Sample
from credit.logged.tables.sources import SAMPLE

LIKELY, ROUNDING = 1e-6, 1e-9  # of 1 − |correlation|, and of a column's range


def copied(sample: Sample, names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Name → an earlier one of which it is a + b·x in every row, and how that is written."""
    own = [name for name in names if sample.kinds[name] == "number" and sample.levels(name) > 1]
    if len(own) < 2:
        return {}
    values = np.stack([np.asarray(sample.frame[name], dtype=np.float64) for name in own])
    gaps = ~np.isfinite(values)
    filled = np.where(gaps, 0.0, values)
    centre = filled.sum(1) / (~gaps).sum(1)
    apart = np.where(gaps, 0.0, values - centre[:, None])
    size = np.sqrt((apart**2).sum(1))
    alike = np.abs(apart @ apart.T) / np.maximum(np.outer(size, size), 1e-300)
    found: dict[str, tuple[str, str]] = {}
    for later, earlier in zip(*np.nonzero(np.tril(alike > 1 - LIKELY, -1)), strict=True):
        name, other = own[later], own[earlier]
        if name in found or other in found or (gaps[later] != gaps[earlier]).any():
            continue
        slope = float(apart[later] @ apart[earlier]) / size[earlier] ** 2
        span = float(np.ptp(values[later][~gaps[later]]))
        if np.abs(apart[later] - slope * apart[earlier]).max() <= ROUNDING * span:
            found[name] = other, _written(name, other, float(centre[later] - slope * centre[earlier]), slope, span)
    return found


def sentences(sample: Sample, names: Sequence[str], actions: Sequence[str]) -> list[str]:
    """What there is to say of features of which one is another in another unit."""
    found = []
    for name, (other, text) in copied(sample, names).items():
        cost = (
            f", or say data.cost={{{other}: {name}}} if it is what {other} cost" if {name, other} <= {*actions} else ""
        )
        found.append(
            f"WARNING: {text} in {_where(sample)}: no window tells what {name} does from what {other} does, and "
            f"numbers of both mean nothing; leave one of them out (data.actions, data.states){cost}"
        )
    return found


def left_out(sample: Sample, said: Sequence[str], guessed: Sequence[str]) -> dict[str, str]:
    """Guessed features that are another one, or one that was said, in another unit, each with a sentence."""
    found = copied(sample, [*said, *guessed])
    return {
        name: f"{name} is left out: {text} in {_where(sample)}, and no window tells them apart"
        for name, (_, text) in found.items()
        if name in guessed
    }


def _where(sample: Sample) -> str:
    return "every row" if len(sample) < SAMPLE else f"all {len(sample)} rows that were looked at"


def _written(name: str, other: str, offset: float, slope: float, span: float) -> str:
    scaled = other if abs(abs(slope) - 1) < ROUNDING else f"{abs(slope):.6g}·{other}"
    if abs(offset) <= ROUNDING * span:
        return f"{name} = {scaled}" if slope > 0 else f"{name} = −{scaled}"
    return f"{name} = {offset:.6g} {'+' if slope > 0 else '−'} {scaled}"

"""Where between its candidates a decay lies: a Newton step from the one that was chosen, in each of some draws.

A grid alone makes intervals that are too narrow: most draws choose the candidate that the data chose, be it right or
not. Draws of a step say how far it can be told, and candidates are then laid where they fall.

With β of the chosen candidate's columns x(c), y ≈ … + x(c) β + Δ · x′(c) β: the coefficient of the column x′(c) β is Δ,
by which the decay is to be moved. x′ is a difference of neighbouring candidates.
"""

from __future__ import annotations

import numpy as np

from credit.logged.fits.linear import Choices, LinearFit, intercept_of
from credit.logged.fits.moments import Moments
from credit.logged.fits.ridge import LAMBDAS, solutions
from credit.logged.panel import Floats

TRIED = 9  # candidates of a refined decay
MOST = 0.97  # decay
WIDER = 0.25  # by which share of their range, at each end, candidates lie beyond the draws
NARROWEST = 0.01


def refined(choices: Choices, whole: Moments, fit: LinearFit) -> dict[str, tuple[float, ...]]:
    """Candidates for each decay that was left open, text of its call → numbers.

    Args:
        choices: of the model. whole: moments of all windows, of all and in some draws [1 + B]. fit: to all [1, D].
    """
    open_terms = [(at, one) for at, one in enumerate(choices.choices) if one.call]
    if not open_terms:
        return {}
    columns = fit.columns(choices)
    map_ = np.zeros((whole.xy.shape[-1], len(columns) + len(open_terms)))
    map_[columns, np.arange(len(columns))] = 1
    for place, (at, one) in enumerate(open_terms, len(columns)):
        chosen = int(fit.chosen[0, at])
        low, high = max(chosen - 1, 0), min(chosen + 1, len(one.decays) - 1)
        own, size = fit.theta[0, one.columns[chosen]], one.decays[high] - one.decays[low]
        np.add.at(map_[:, place], one.columns[high], own / size)
        np.add.at(map_[:, place], one.columns[low], -own / size)
    moved = Moments(map_.T @ whole.xx @ map_, whole.xy @ map_, whole.yy, whole.weight)
    free = intercept_of(choices)
    places = np.flatnonzero(columns == (-1 if free is None else free))
    theta = solutions(moved, LAMBDAS[:1], int(places[0]) if len(places) else None)[:, 0, len(columns) :]
    return {
        one.call: _around(one.decays[int(fit.chosen[0, at])], step)
        for (at, one), step in zip(open_terms, theta.T, strict=True)
    }


def _around(chosen: float, steps: Floats) -> tuple[float, ...]:
    """Candidates where draws of a decay fall, and the one from which they went."""
    there = np.clip(chosen + steps, 0, MOST)
    low, high = min(float(there.min()), chosen), max(float(there.max()), chosen)
    beyond = max(WIDER * (high - low), NARROWEST)
    every = np.linspace(max(low - beyond, 0), min(high + beyond, MOST), TRIED)
    return tuple(sorted({chosen, *map(float, every.round(3))}))

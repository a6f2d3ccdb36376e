"""How much the error of a step hangs together with the one before it: ρ, from labels of whole windows alone.

By maximum likelihood, θ and σ² being put at their best for every ρ (Bournay and Laroque 1979; `chow-lin-maxlog` of R's
tempdisagg), or by the least sum of squares r'V⁻¹r (`chow-lin-minrss-quilis`), which is not invariant: it has no price
for a V that is large, and is here to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from credit.core.errors import UserError
from credit.logged.panel import Floats
from credit.logged.residuals.loops import products, squares
from credit.logged.residuals.whitening import Layout, whiten

# Sums of windows say next to nothing of a ρ below 0: with windows of 7, −.5 makes neighbours correlate by −.08, or by
# one standard error at 150 windows. Where it is 0, every other estimate would be some −.5, and steps' shares would
# swing. (R's tempdisagg cuts it off at 0, too.)
LOW, HIGH = 0.0, 0.999
GRID = (-0.9, -0.6, -0.3, 0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.96, 0.99, 0.999)
DIGITS = 4  # far below its standard error: what is printed is what is used, and rounding elsewhere does not move it
FEWEST = 3  # windows beyond those that θ takes, below which nothing is told
NOTHING = 1e-10  # of a label's size, below which nothing is left over
NEAR = 1e-4  # of a number of the grid: ρ is still moving
MANY = 50_000  # windows, from which on θ hardly moves with ρ, and the grid is of what one θ leaves


@dataclass(frozen=True)
class Autocorrelation:
    """An estimate.

    Attributes:
        rho: ρ, rounded. theta: θ at it [d]. variance: σ², of a step's ε. likelihood: log-likelihood at it.
        said: where it comes from, a sentence.
    """

    rho: float
    theta: Floats
    variance: float
    likelihood: float
    said: str


def estimated_rho(
    design: Floats,
    label: Floats,
    layout: Layout,
    *,
    penalty: Floats | None = None,
    low: float = LOW,
    high: float = HIGH,
    criterion: Literal["likelihood", "rss"] = "likelihood",
) -> Autocorrelation:
    """The ρ at which labels are most likely. There may be more than one top, so that a grid is looked at first.

    Args:
        design: windows' features, as labels are (sums, means or the last row) [W, d]; d may be 0. label: Y [W].
        layout: how windows lie. penalty: what is added to XᵀV⁻¹X [d, d]; then σ² has θᵀ penalty θ, too.
        low, high: between what ρ is looked for. criterion: what is best.

    Raises:
        UserError: bounds that are none.
    """
    if not -1 < low <= high < 1:
        raise UserError(f"rho: it cannot lie between {low} and {high}; allowed: −1 < low ≤ high < 1")
    profile = _Profile(np.concatenate([design, label[:, None]], axis=1), layout, penalty, criterion)
    start = profile(min(max(0.0, low), high))
    if profile.silent or start.cost <= NOTHING**2 * start.size:
        why = "there is nothing left of the labels"
        if profile.silent:
            why = f"{profile.count} labels for {design.shape[1]} columns tell no more of it"
        return start.estimate(f"ρ = {_short(start.rho)}: {why}")
    grid = [low, *(rho for rho in GRID if low < rho < high), *([high] if low < high else [])]
    coarse = profile
    if len(label) > MANY:
        coarse = _Profile(label[:, None] - design @ start.theta[:, None], layout, None, criterion)
    best = int(np.argmin([coarse(rho).value for rho in grid]))
    point = profile(grid[best])
    for _ in grid:
        inside = profile.between(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
        point = min([point, *inside], key=lambda each: each.value)
        near = [number for number, rho in enumerate(grid) if abs(rho - point.rho) < NEAR]
        if near in ([], [best]):
            break
        best = near[0]  # one θ did not point between the right ones
    point = profile(min(max(round(point.rho, DIGITS), low), high))
    said = f"ρ = {_short(point.rho)}, by {'maximum likelihood' if criterion == 'likelihood' else 'least squares'}"
    bound = " (at its bound)" if point.rho in (low, high) else ""
    return point.estimate(f"{said} of {profile.count} labels{bound}")


class _Point(NamedTuple):
    """What is known at a ρ; `value` is to be small."""

    rho: float
    value: float
    cost: float
    size: float
    theta: Floats
    variance: float
    likelihood: float

    def estimate(self, said: str) -> Autocorrelation:
        return Autocorrelation(self.rho, self.theta, self.variance, self.likelihood, said)


class _Profile:
    """What ρ is worth where θ and σ² are best for it."""

    def __init__(self, both: Floats, layout: Layout, penalty: Floats | None, criterion: str) -> None:
        self.both, self.layout, self.penalty, self.criterion = both, layout, penalty, criterion
        self.count = int(layout.labelled.sum())
        self.silent = self.count - (both.shape[1] - 1) < FEWEST
        self._room = np.empty_like(both)

    def __call__(self, rho: float) -> _Point:
        white, logdet = whiten(self.both, self.layout, rho, self._room)
        moments = np.zeros((white.shape[1], white.shape[1]))
        products(white, moments)
        theta = solved(moments[:-1, :-1], moments[:-1, -1], self.penalty)
        cost = squares(white, np.append(-theta, 1.0))  # not from the moments, which lose digits where little is left
        if self.penalty is not None:
            cost += float(theta @ self.penalty @ theta)
        variance = max(cost, np.finfo(float).tiny) / max(self.count, 1)
        likelihood = -0.5 * (self.count * (np.log(2 * np.pi * variance) + 1) + logdet)
        value = cost if self.criterion == "rss" else -likelihood
        return _Point(rho, value, cost, float(moments[-1, -1]), theta, variance, likelihood)

    def between(self, low: float, high: float) -> list[_Point]:
        """The best inside, none if there is no inside."""
        from scipy.optimize import minimize_scalar

        if not low < high:
            return []
        found = minimize_scalar(
            lambda rho: self(rho).value, bounds=(low, high), method="bounded", options={"xatol": 1e-5}
        )
        return [self(float(found.x))]


def solved(gram: Floats, right: Floats, penalty: Floats | None = None) -> Floats:
    """(gram + penalty)⁻¹ right [d]; of many solutions the smallest, in units in which columns are equally large."""
    gram = gram if penalty is None else gram + penalty
    root = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(root > 0, root, 1.0)
    return np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-13)[0] / scale


def _short(rho: float) -> str:
    return f"{rho:.{DIGITS}f}".rstrip("0").rstrip(".")

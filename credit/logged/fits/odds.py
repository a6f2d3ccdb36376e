"""Labels that are bits: their log-odds are a sum over the rows of a window and an intercept of the window.

P(Y = 1) = σ(b + Σ_t φ_tᵀθ), fitted by penalised likelihood (Newton's method), with a weight for every window. There are
no moments to add up, so every fit sees all windows. λ and the candidates of terms are chosen by contiguous folds in the
point fit, by the likelihood of labels that were held out, and the draws keep them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from credit.core.errors import UserError
from credit.logged.fits.folds import Folds
from credit.logged.fits.linear import Choices, LinearFit, intercept_of
from credit.logged.fits.ridge import LAMBDAS
from credit.logged.fits.units import Units
from credit.logged.panel import Floats, Ints

WIDE = 100.0  # variance of the intercept's prior: a label that is always the same must not lead to infinity
NEWTON, CLOSE = 100, 1e-10  # steps at most, and the last one, for an intercept alone
NUMBERS = 20_000_000  # that are looked at together


@dataclass(frozen=True)
class Bits:
    """Windows with bits, and how models are fitted to them.

    Args:
        x: design of windows [W, D]. y: Y, 0 or 1, where known [W]. folds, units, draws, seed: as of `linear.Fitting`.
    """

    x: Floats
    y: Floats
    folds: Folds
    units: Units | None
    draws: int = 0
    seed: int = 0

    @property
    def known(self) -> Ints:
        """Windows that have a label."""
        return np.flatnonzero(np.isfinite(self.y)).astype(np.int64)

    def fit(self, choices: Choices, regularization: float | None = None) -> tuple[LinearFit, Floats]:
        """All fits, and the intercepts of windows [1 + B]."""
        penalties = LAMBDAS[::2] if regularization is None else np.array([float(regularization)])
        chosen = [0] * len(choices.choices)
        for term, one in enumerate(choices.choices):
            costs = [
                self._held_out(choices.chosen([*chosen[:term], number, *chosen[term + 1 :]]), choices, [1.0]).min()
                for number in range(len(one.columns))
            ]
            chosen[term] = int(np.argmin(costs))
        columns = choices.chosen(chosen)
        errors = self._held_out(columns, choices, penalties)
        penalty = float(penalties[int(errors.argmin())])
        theta, intercept = self._solved(columns, choices, penalty, self.known, 1 + self.draws)
        every = np.tile(np.array(chosen, dtype=np.int64), (1 + self.draws, 1))
        return LinearFit(theta, np.full(1 + self.draws, penalty), every, float(errors.min())), intercept

    def without(self, choices: Choices, fit: LinearFit, fold: int, draws: int) -> tuple[Floats, Floats]:
        """θ [1 + draws, D] and intercepts of fits that have not seen a fold."""
        fitted = self.folds.of[fold][1]
        windows = self.known[np.isin(self.folds.piece[self.known], fitted)]
        return self._solved(fit.columns(choices), choices, float(fit.penalty[0]), windows, 1 + draws)

    def _held_out(self, columns: Ints, choices: Choices, penalties: Sequence[float] | Floats) -> Floats:
        """Minus the log-likelihood of labels that were held out, for each penalty."""
        total = np.zeros(len(penalties))
        if len(self.folds.of) < 2:
            return total
        for tested, fitted in self.folds.of:
            inside = self.known[np.isin(self.folds.piece[self.known], fitted)]
            outside = self.known[np.isin(self.folds.piece[self.known], tested)]
            for number, penalty in enumerate(penalties):
                theta, intercept = self._solved(columns, choices, penalty, inside, 1)
                odds = self.x[outside] @ theta[0] + intercept[0]
                total[number] += (np.logaddexp(0, odds) - self.y[outside] * odds).sum()
        return total

    def _solved(
        self, columns: Ints, choices: Choices, penalty: float, windows: Ints, fits: int
    ) -> tuple[Floats, Floats]:
        """θ [fits, D] and intercepts [fits], a few fits at a time."""
        import torch

        from credit.recovery.models.logistic import newton

        x, y = self.x[windows][:, columns], self.y[windows]
        one = intercept_of(choices)
        center = x.mean(0) if len(x) else np.zeros(len(columns))
        size = np.sqrt(((x - center) ** 2).mean(0)) if len(x) else center
        if one is not None:  # the intercept of rows: held back no more than that of windows
            at = np.flatnonzero(columns == one)
            size[at] = np.maximum(center[at], 1e-300)
        scale = np.where(size > 1e-10 * np.maximum(np.abs(center), 1e-300), size, np.inf)
        prior = np.full(len(columns) + 1, penalty)
        prior[-1] = 1 / WIDE
        if one is not None:
            prior[:-1][columns == one] = 1 / WIDE
        if self.units is None or fits == 1:
            weights = np.ones((len(windows), fits))
        else:
            weights = self.units.weights(self.units.of[windows], fits - 1, self.seed)
        theta, intercept = np.zeros((fits, self.x.shape[1])), np.zeros(fits)
        at_once = max(1, NUMBERS // max(x.size, 1))
        start = torch.zeros(1, len(columns) + 1, dtype=torch.float64)
        for first in range(0, fits, at_once):
            some = torch.from_numpy(weights[:, first : first + at_once].copy())
            found, _ = newton(
                torch.from_numpy(x / scale), torch.from_numpy(y), some, torch.from_numpy(prior),
                start.expand(some.shape[1], -1).clone(),
            )  # fmt: skip
            start = found[:1]
            theta[first : first + at_once, columns] = found[:, :-1].numpy() / scale
            intercept[first : first + at_once] = found[:, -1].numpy()
        return theta, intercept


def intercept(sums: Floats, bits: Floats) -> float:
    """b that makes bits most likely whose log-odds are b and a sum [W]: Newton's method, with the prior of all fits."""
    found = 0.0
    for _ in range(NEWTON):
        chance = 1 / (1 + np.exp(-np.clip(sums + found, -500, 500)))
        step = ((bits - chance).sum() - found / WIDE) / ((chance * (1 - chance)).sum() + 1 / WIDE)
        found += float(np.clip(step, -5, 5))
        if abs(step) < CLOSE:
            break
    return found


def require_bits(labels: Floats, ids: Sequence[object]) -> None:
    """Refuse labels that are no bits.

    Raises:
        UserError: with the first one and its window.
    """
    wrong = np.isfinite(labels) & (labels != 0) & (labels != 1)
    if wrong.any():
        at = int(wrong.argmax())
        raise UserError(
            f"data.label_is=binary: the label of window {ids[at]!r} is {labels[at]:.6g}; allowed are 0 and 1; "
            "set data.label_is=sum for labels that are numbers"
        )

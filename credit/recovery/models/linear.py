"""The linear estimator: ridge regression of labels on summed features, exact and updated window by window."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.cells import Axis
from credit.core.checks import require_equal_lengths
from credit.core.compiled import usable
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Credit, Name, Positive
from credit.core.seams import FeatureMap, Likelihood, Places
from credit.core.state import pack
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.tensors import CACHED, by_replica, matvec
from credit.recovery.models.logistic import LogisticFits, check_bits, require_bits
from credit.recovery.models.loops import sherman_morrison
from credit.recovery.models.ridge import RidgeModel
from credit.recovery.uncertainty.bootstrap import Analytic, FitUncertainty

LARGEST = 10**9  # numbers in the inverses of all fits, 8 GB


class LinearModel(RidgeModel):
    """Linear in a feature map, fitted to window labels by ridge regression (4), (6).

    θ = argmin Σ_i w_i (Y_i − x_iᵀθ)² + λ‖θ‖², with x_i = Σ_{t∈i} φ(s_t, a_t) / unit. On the identity map this is the
    tabular ridge reference, on four features the linear surrogate, on the cells of a maze the box surrogate (3.3).
    R × (1 + B) fits are kept as V⁻¹ = (XᵀWX + λI)⁻¹ and θ and updated by the Sherman–Morrison formula (recursive least
    squares): exact, O(d²) a window whatever came before.

    Args:
        name: the model's name in metrics, files and figures.
        features: the feature map φ.
        uncertainty: further fits with other weights, or the variance of ridge regression; None for the latter with σ²
            from the fit, as it is beside networks whose uncertainty is not for linear models.
        regularization: λ > 0.
        credit: which steps of a window share its label: every one alike, or the last alone (on tables).
        unit: steps that are counted as one: it sets the scale on which λ acts.
        likelihood: of labels: gaussian, as above, or logistic, of bits whose log-odds the sum is (`models.logistic`).
    """

    keeps: ClassVar = ("_inverse", "_theta", "_cost", "_windows")

    def __init__(
        self,
        name: Name,
        features: FeatureMap,
        uncertainty: FitUncertainty | None = None,
        regularization: Positive = 0.1,
        credit: Credit = "every_step",
        unit: Positive = 1.0,
        likelihood: Likelihood = "gaussian",
    ) -> None:
        self.name = name
        self.features = features
        self.uncertainty = Analytic(noise=None) if uncertainty is None else uncertainty
        self.regularization = regularization
        self.credit = credit
        self.unit = unit
        self.likelihood = likelihood

    @property
    def looks_at(self) -> Collection[Axis]:  # type: ignore[override]
        """What the features read, and the step where only the last one counts."""
        return {*self.features.looks_at, *(("step",) if self.credit == "last_step" else ())}

    def start(self, problem: Problem, places: Places) -> None:
        """Empty fits: θ = 0, V = λI.

        Raises:
            UserError: credit to the last step, where there is no table; too many features; or logistic, of no bits.
        """
        if self.likelihood == "logistic":
            require_bits(self.name, problem)
        if self.credit == "last_step" and places.cells is None:
            raise UserError(
                f"reward model {self.name!r}: credit=last_step needs states and actions that are numbers; "
                "use credit=every_step"
            )
        self._problem, self._last = problem, problem.window - 1
        self.features.start(problem)
        self.uncertainty.start(problem)
        self._shape = (problem.replicas, 1 + self.uncertainty.draws, self._phi(problem.blank()).shape[-1])
        replicas, fits, size = self._shape
        if (numbers := replicas * fits * size**2) > LARGEST:
            raise UserError(
                f"reward model {self.name!r}: {size} features, {fits} fits and {replicas} seeds need {numbers:.1e} "
                f"numbers, at most {LARGEST:.0e} are kept; use reward=ridge_table for a table of many cells, fewer "
                "features, or fewer seeds side by side (replicas)"
            )
        self._tabular, self._look = places.cells is not None, places.look(self._phi)
        self._reset()

    def _phi(self, steps: Steps) -> Tensor:
        """φ as the fits see it, in the type in which it is kept."""
        values = self.features(steps)
        return values if self.credit == "every_step" else values * (steps.times == self._last).unsqueeze(-1)

    def _reset(self) -> None:
        replicas, fits, size = self._shape
        eye = torch.eye(size, dtype=FLOAT, device=self._problem.device) / self.regularization
        self._inverse = eye.repeat(replicas, fits, 1, 1)
        self._theta = eye.new_zeros(self._shape)
        self._cost = eye.new_zeros(replicas)  # Σ_i (Y_i − x_iᵀθ)² + λ‖θ‖² of the point fit
        self._windows: Tensor | int = 0
        self._odds: LogisticFits | None = None
        if self.likelihood == "logistic":
            self._odds = LogisticFits(self._problem, fits, size, self.regularization)

    def _names(self) -> tuple[str, ...]:
        return (*super()._names(), *(() if self._odds is None else ("_odds",)))

    def acting(self) -> dict[str, Any]:
        """What predictions look at: of the inverses that of the point fit; the others are for windows to come."""
        return super().acting() | {"_inverse": pack(self._inverse[:, :1], "LinearModel._inverse")}

    def observe(self, store: Store) -> None:
        """Update every fit with the newest windows, or fit all windows anew, as the uncertainty has it.

        Raises:
            RunError: a label or a feature is not finite, or the last step is asked for where windows end early.
        """
        if self.credit == "last_step":
            require_equal_lengths(self.name, store.new)
        if self._odds is not None:
            check_bits(self.name, store.new)
        weights, anew = self.uncertainty.weights(store)
        windows = store.windows if anew else store.new
        sums = windows.sums(self._look.rows(windows, newest=not anew).to(FLOAT))
        self.fit(sums if self.unit == 1 else sums / self.unit, windows.labels, weights, anew)
        if not (self._tabular or self._theta.isfinite().all()):  # tables have the features of their cells
            bad = (~self._theta.flatten(1).isfinite().all(1)).nonzero().flatten().tolist()
            seeds = ", ".join(str(self._problem.seeds[replica]) for replica in bad)
            raise RunError(
                f"reward model {self.name!r}: a coefficient of seed {seeds} is not finite after {len(store)} windows; "
                "are labels and states finite?"
            )

    def fit(self, sums: Tensor, labels: Tensor, weights: Tensor, anew: bool = False) -> None:
        """Update every fit.

        Args:
            sums: x [R, k, d]. labels: Y [R, k]. weights: [R, k, 1+B]. anew: forget what was before.
        """
        if self._odds is not None:
            self._theta, self._inverse = self._odds.fit(self._theta, sums, labels, weights, anew)
        elif anew:
            self._solve(sums, labels, weights)
        elif sums.shape[1] > self._shape[-1]:
            self._absorb(sums, labels, weights)
        else:
            self._step(sums, labels, weights)
        self._windows = weights[..., 0].sum(1) + (0 if anew else self._windows)  # of the point fit, each with a label

    def _step(self, sums: Tensor, labels: Tensor, weights: Tensor) -> None:
        """One window after the other, by the Sherman–Morrison formula."""
        if usable(self._theta):
            sherman_morrison(self._inverse, self._theta, self._cost, sums, labels, weights)
            return
        replicas, fits, size = self._shape
        flat = self._inverse.view(replicas * fits, size, size)
        for k in range(sums.shape[1]):
            x, w = sums[:, k], weights[:, k]
            u = matvec(self._inverse.view(replicas, fits * size, size), x).view(self._shape)
            scale = torch.addcmul(torch.ones_like(w), w, matvec(u, x))
            gain = u * (w / scale).unsqueeze(-1)
            error = labels[:, k : k + 1] - matvec(self._theta, x)
            if self.uncertainty.sees_residuals:
                self._cost += w[:, 0] * error[:, 0].square() / scale[:, 0]
            flat.baddbmm_(gain.view(-1, size, 1), u.view(-1, 1, size), alpha=-1)
            self._theta.addcmul_(gain, error.unsqueeze(-1))

    def _absorb(self, x: Tensor, labels: Tensor, weights: Tensor) -> None:
        """The same for more windows than features, [R, K, d]: one inverse is cheaper than K updates."""
        weighted = x.unsqueeze(1) * weights.mT.unsqueeze(-1)  # [R, F, K, d]
        precision = torch.linalg.inv(self._inverse) + weighted.mT @ x.unsqueeze(1)
        error = labels.unsqueeze(1) - self._theta @ x.mT
        self._inverse = torch.linalg.inv(precision).contiguous()
        step = (self._inverse @ (weighted.mT @ error.unsqueeze(-1))).squeeze(-1)
        if self.uncertainty.sees_residuals:  # ‖e‖² − eᵀXΔθ = eᵀ(I + XVXᵀ)⁻¹e
            counted = weights[..., 0] * error[:, 0]
            self._cost += (counted * (error[:, 0] - (x @ step[:, 0].unsqueeze(-1)).squeeze(-1))).sum(-1)
        self._theta += step

    def _solve(self, x: Tensor, labels: Tensor, weights: Tensor) -> None:
        """Forget everything and solve the weighted normal equations."""
        self._reset()
        penalty = self.regularization * torch.eye(x.shape[-1], dtype=FLOAT, device=x.device)
        for fit in range(weights.shape[-1]):  # one fit at a time bounds the memory to that of the windows
            weighted = x * weights[..., fit].unsqueeze(-1)
            inverse = torch.linalg.inv(weighted.mT @ x + penalty)
            self._inverse[:, fit] = inverse
            self._theta[:, fit] = (inverse @ (weighted.mT @ labels.unsqueeze(-1))).squeeze(-1)

    def estimate(self, at: Tensor | None = None) -> Estimate:
        """Predictions Φθ for some places [R, n], or for all: the point fit and the B draws."""
        return self._predict(self._look.places(at))

    def believe(self, steps: Steps) -> Estimate:
        """Predictions for other steps [n]."""
        return self._predict(self._phi(steps))

    def _predict(self, phi: Tensor) -> Estimate:
        """What φ [N, d] or [R, N, d] comes to."""
        values = self._each(lambda phi, theta: theta @ phi.mT, phi, self._theta)
        draws = values[:, 1:]
        if self._odds is not None and not self.uncertainty.draws:  # Laplace's, in which no noise appears
            variance = self._leverage(phi)
        else:
            variance = self.uncertainty.variance(draws, lambda: self._leverage(phi), self.residual)
        if self._odds is None:
            return Estimate(values[:, 0], variance, draws)
        return Estimate(values[:, 0], variance, draws, self._odds.intercept[:, 1:])

    def _leverage(self, phi: Tensor) -> Tensor:
        """φᵀV⁻¹φ [R, N]."""
        return self._each(lambda phi, inverse: ((phi @ inverse) * phi).sum(-1), phi, self._inverse[:, 0])

    def _each(self, function: Callable[[Tensor, Tensor], Tensor], phi: Tensor, of_fits: Tensor) -> Tensor:
        """A function of φ [N, d] or [R, N, d], in units, and of something [R, ...]; single steps are many."""
        if self._tabular:
            return function(self._in_units(phi), of_fits)
        rows = phi.expand(len(of_fits), *phi.shape[-2:])

        def in_parts(phi: Tensor, own: Tensor) -> Tensor:  # that stay in the cache
            parts = phi.split(max(1, CACHED // (8 * phi.shape[-1])), dim=-2)
            return torch.cat([function(self._in_units(part.to(FLOAT)), own) for part in parts], dim=-1)

        return by_replica(in_parts, rows, of_fits)

    def _in_units(self, phi: Tensor) -> Tensor:
        return phi if self.unit == 1 else phi / self.unit

    def looks(self) -> Tensor:
        """Cells with the same features have the same prediction."""
        return torch.unique(self._look.places(), dim=0, return_inverse=True)[1]

    @property
    def theta(self) -> Tensor:
        """The point fit's coefficients [R, d]: reward for `unit` steps."""
        return self._theta[:, 0]

    def residual(self) -> Tensor:
        """Mean squared error of the point fit's labels [R], 0 before the first; kept where the uncertainty asks."""
        cost = self._cost - self.regularization * self.theta.square().sum(-1)
        return cost.clamp(min=0) / torch.as_tensor(self._windows).clamp(min=1)

    def leverage(self, steps: Steps | None = None) -> Tensor:
        """φᵀV⁻¹φ of every place [R, N], or of other steps [n]: the squared width of the proof's confidence set (38)."""
        phi = self._look.places() if steps is None else self._phi(steps)
        return self._leverage(phi)

    def perturbation(self, normal: Tensor, steps: Steps | None = None) -> Tensor:
        """Φ L z with L Lᵀ = V⁻¹: a posterior draw of the reward, less its mean.

        Args:
            normal: z, standard normal numbers [R, d]. steps: of which [n]; None for every place.

        Returns:
            [R, N], or [R, n].
        """
        phi = self._look.places() if steps is None else self._phi(steps)
        factor = torch.linalg.cholesky(self._inverse[:, 0])
        return (self._in_units(phi.to(FLOAT)) @ (factor @ normal.unsqueeze(-1))).squeeze(-1)

"""The linear estimator: ridge regression of labels on summed features, exact and updated window by window."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.cells import Axis
from credit.core.interfaces import FeatureMap
from credit.core.tables import RidgeModel
from credit.core.tensors import matvec
from credit.core.types import FLOAT, Credit, Estimate, Positive, Problem, Windows


class LinearModel(RidgeModel):
    """Linear in a feature map, fitted to window labels by ridge regression (4), (6).

    θ = argmin Σ_i w_i (Y_i − x_iᵀθ)² + λ‖θ‖², with x_i = Σ_{t∈i} φ(s_t, a_t). On the identity map this is the tabular
    ridge reference, on four features the linear surrogate. R × (1 + B) fits are kept as V⁻¹ = (XᵀWX + λI)⁻¹ and θ and
    updated by the Sherman–Morrison formula (recursive least squares): exact, O(d²) a window whatever came before.

    Args:
        name: the model's name in metrics, files and figures.
        features: the feature map φ.
        regularization: λ > 0.
        credit: which steps of a window share its label: every one alike, or the last alone.
    """

    keeps: ClassVar = ("_inverse", "_theta")

    def __init__(
        self, name: str, features: FeatureMap, regularization: Positive = 0.1, credit: Credit = "every_step"
    ) -> None:
        self.name = name
        self.features = features
        self.regularization = regularization
        self.credit = credit

    @property
    def looks_at(self) -> Collection[Axis]:  # type: ignore[override]
        """What the features read, and the step where only the last one counts."""
        return {*self.features.looks_at, *(("step",) if self.credit == "last_step" else ())}

    def start(self, problem: Problem, draws: int) -> None:
        """Empty fits: θ = 0, V = λI."""
        self._cells = problem.cells
        self.features.start(problem)
        steps = problem.cells.steps(problem.device)
        self.table = self.features(steps)
        if self.credit == "last_step":
            self.table = self.table * (steps.times == problem.window - 1).unsqueeze(-1)
        self._shape = (problem.replicas, 1 + draws, self.table.shape[-1])
        self._reset()

    def _reset(self) -> None:
        replicas, fits, size = self._shape
        eye = torch.eye(size, dtype=FLOAT, device=self.table.device) / self.regularization
        self._inverse = eye.repeat(replicas, fits, 1, 1)
        self._theta = eye.new_zeros(self._shape)

    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Update every fit with windows [R, K, T] and weights [R, K, 1+B]."""
        sums = self.window_features(windows)
        replicas, fits, size = self._shape
        if sums.shape[1] > size:
            self._absorb(sums, windows.labels, weights)
            return
        flat = self._inverse.view(replicas * fits, size, size)
        for k in range(sums.shape[1]):
            x, w = sums[:, k], weights[:, k]
            u = matvec(self._inverse.view(replicas, fits * size, size), x).view(self._shape)
            gain = u * (w / torch.addcmul(torch.ones_like(w), w, matvec(u, x))).unsqueeze(-1)
            error = windows.labels[:, k : k + 1] - matvec(self._theta, x)
            flat.baddbmm_(gain.view(-1, size, 1), u.view(-1, 1, size), alpha=-1)
            self._theta.addcmul_(gain, error.unsqueeze(-1))

    def _absorb(self, x: Tensor, labels: Tensor, weights: Tensor) -> None:
        """The same for more windows than features, [R, K, d]: one inverse is cheaper than K updates."""
        weighted = x.unsqueeze(1) * weights.mT.unsqueeze(-1)  # [R, F, K, d]
        precision = torch.linalg.inv(self._inverse) + weighted.mT @ x.unsqueeze(1)
        self._inverse = torch.linalg.inv(precision).contiguous()
        error = labels.unsqueeze(1) - self._theta @ x.mT
        self._theta += (self._inverse @ (weighted.mT @ error.unsqueeze(-1))).squeeze(-1)

    def refit(self, windows: Windows, weights: Tensor) -> None:
        """Forget everything and solve the weighted normal equations of windows [R, K, T]."""
        self._reset()
        x = self.window_features(windows)
        penalty = self.regularization * torch.eye(x.shape[-1], dtype=FLOAT, device=x.device)
        for fit in range(weights.shape[-1]):  # one fit at a time bounds the memory to that of the windows
            weighted = x * weights[..., fit].unsqueeze(-1)
            inverse = torch.linalg.inv(weighted.mT @ x + penalty)
            self._inverse[:, fit] = inverse
            self._theta[:, fit] = (inverse @ (weighted.mT @ windows.labels.unsqueeze(-1))).squeeze(-1)

    def estimate(self, cells: Tensor | None = None) -> Estimate:
        """Predictions Φθ for some cells [R, n], or for all: the point fit and the B draws."""
        values = self._theta @ (self.table if cells is None else self.table[cells]).mT
        return Estimate(values[:, 0], values[:, 1:])

    def looks(self, problem: Problem) -> Tensor:
        """Cells with the same features have the same prediction."""
        return torch.unique(self.table, dim=0, return_inverse=True)[1]

    def window_features(self, windows: Windows) -> Tensor:
        """x_i = Σ_t φ(s_t, a_t) of every window, [R, K, d]."""
        return self.table[self._cells.index(windows)].sum(-2)

    @property
    def theta(self) -> Tensor:
        """The point fit's coefficients [R, d]."""
        return self._theta[:, 0]

    def leverage(self) -> Tensor:
        """φᵀV⁻¹φ of every cell [R, N], the squared width of the proof's confidence set (38)."""
        return torch.einsum("nd,rde,ne->rn", self.table, self._inverse[:, 0], self.table)

    def perturbation(self, normal: Tensor) -> Tensor:
        """Φ L z with L Lᵀ = V⁻¹ for standard normal z [R, d]: a posterior draw of the reward, less its mean [R, N]."""
        factor = torch.linalg.cholesky(self._inverse[:, 0])
        return (self.table @ (factor @ normal.unsqueeze(-1))).squeeze(-1)

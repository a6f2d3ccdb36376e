"""The linear estimator on the identity map when there are many cells: conjugate gradient on those that were visited."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.cells import PAIRS, Axis
from credit.interfaces import RewardModel
from credit.tensors import grown
from credit.types import FLOAT, Credit, Estimate, Positive, PositiveInt, Problem, Windows


class TableModel(RewardModel):
    """Tabular ridge reference (4) for thousands of cells, batched over draws.

    (XᵀWX + λI)θ = XᵀWY is solved after every `observe` by conjugate gradient with a Jacobi preconditioner, from the
    last solution on. Only visited cells have unknowns (θ is 0 elsewhere), and X is kept as its T indices a window:
    memory is O(K·(T + B) + visited cells·B) a replica. Replicas are solved one after the other.

    Args:
        name: the model's name in metrics, files and figures.
        looks_at: the axes of the table.
        credit: which steps of a window share its label: every one alike, or the last alone.
        regularization: λ > 0.
        tolerance: relative residual at which a fit stops; 1e-2 goes stale.
        iterations: most iterations a solve.
    """

    domain: ClassVar = "tabular"

    def __init__(
        self,
        name: str = "ridge",
        looks_at: Sequence[Axis] = PAIRS,
        credit: Credit = "every_step",
        regularization: Positive = 10.0,
        tolerance: Positive = 1e-4,
        iterations: PositiveInt = 200,
    ) -> None:
        self.name = name
        self.looks_at = {*looks_at, "step"} if credit == "last_step" else looks_at
        self.credit = credit
        self.regularization = regularization
        self.tolerance = tolerance
        self.iterations = iterations

    def start(self, problem: Problem, draws: int) -> None:
        """No cell was visited."""
        self._problem = problem
        self._first = problem.window - 1 if self.credit == "last_step" else 0
        self._fits = [_Fit(problem, problem.window - self._first, 1 + draws) for _ in problem.seeds]

    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Add windows [R, K, T] with weights [R, K, 1+B] and solve."""
        cells = self._problem.cells.index(windows)[..., self._first :]
        for fit, *new in zip(self._fits, cells, weights, windows.labels, strict=True):
            fit.add(*new)
            fit.solve(self.regularization, self.tolerance, self.iterations)

    def refit(self, windows: Windows, weights: Tensor) -> None:
        """Forget the windows and fit these; the last solution is the first guess."""
        for fit in self._fits:
            fit.rows = 0
        self.observe(windows, weights)

    def estimate(self) -> Estimate:
        """θ for every cell: the point fit [R, N] and the B draws [R, B, N]."""
        table = self._problem.zeros(self._fits[0].theta.shape[1], self._problem.cells.count)
        for rows, fit in zip(table, self._fits, strict=True):
            rows[:, fit.cells] = fit.theta.T
        return Estimate(table[:, 0], table[:, 1:])


class _Fit:
    """The windows of one replica and its 1 + B solutions; small enough to stay in the processor's cache."""

    def __init__(self, problem: Problem, width: int, fits: int) -> None:
        device = problem.device
        self._column = torch.full((problem.cells.count,), -1, device=device)  # cell → unknown
        self.cells = torch.zeros(0, dtype=torch.int64, device=device)  # unknown → cell
        self.theta = torch.zeros(0, fits, dtype=FLOAT, device=device)
        self.rows = 0
        self._index = torch.zeros(1, 256, width, dtype=torch.int64, device=device)
        self._weights = torch.zeros(1, 256, fits, dtype=FLOAT, device=device)
        self._labels = torch.zeros(1, 256, 1, dtype=FLOAT, device=device)

    def add(self, cells: Tensor, weights: Tensor, labels: Tensor) -> None:
        """Append windows [K, T] with weights [K, 1+B] and labels [K]; cells seen for the first time become unknowns."""
        fresh = torch.unique(cells[self._column[cells] < 0])
        self._column[fresh] = torch.arange(len(self.cells), len(self.cells) + len(fresh), device=cells.device)
        self.cells = torch.cat([self.cells, fresh])
        self.theta = torch.cat([self.theta, self.theta.new_zeros(len(fresh), self.theta.shape[1])])
        before, self.rows = self.rows, self.rows + len(cells)
        if self.rows > self._index.shape[1]:
            blocks = (self._index, self._weights, self._labels)
            self._index, self._weights, self._labels = (grown(block, self.rows) for block in blocks)
        self._index[0, before : self.rows] = self._column[cells]
        self._weights[0, before : self.rows] = weights
        self._labels[0, before : self.rows, 0] = labels

    def solve(self, regularization: float, tolerance: float, iterations: int) -> None:
        """Preconditioned conjugate gradient for all fits at once; a fit that has converged stands still."""
        weights, labels = self._weights[0, : self.rows], self._labels[0, : self.rows]
        design = Design(self._index[0, : self.rows], len(self.cells))
        target = design.transposed(weights * labels)
        diagonal = design.transposed(weights).add_(regularization)
        theta = self.theta
        residual = target - design.transposed(weights * design(theta)).add_(theta, alpha=regularization)
        enough = tolerance**2 * (target * target).sum(0)
        step = residual / diagonal
        energy = (residual * step).sum(0)
        for _ in range(iterations):
            active = (residual * residual).sum(0) > enough
            if not active.any():
                break
            image = design.transposed(weights * design(step)).add_(step, alpha=regularization)
            length = torch.where(active, energy / (step * image).sum(0), 0.0)
            theta = torch.addcmul(theta, length, step)
            residual = torch.addcmul(residual, length, image, value=-1)
            scaled = residual / diagonal
            following = (residual * scaled).sum(0)
            step = torch.addcmul(scaled, torch.where(active, following / energy, 0.0), step)
            energy = torch.where(active, following, energy)
        self.theta = theta


class Design:
    """X as T column indices a window: X @ v and Xᵀ @ z for v [V, F], z [rows, F]."""

    def __init__(self, index: Tensor, columns: int) -> None:
        self._index, self._columns = index, columns
        self._sparse = None
        if index.device.type == "cpu":  # SciPy is several times faster than torch's gather and scatter here
            rows, width = index.shape
            cells = (np.ones(index.numel()), index.flatten().numpy(), np.arange(0, rows * width + 1, width))
            self._sparse = csr_array(cells, shape=(rows, columns))

    def __call__(self, vectors: Tensor) -> Tensor:
        """X @ v."""
        if self._sparse is not None:
            return torch.from_numpy(self._sparse @ vectors.numpy())
        return vectors[self._index].sum(1)

    def transposed(self, vectors: Tensor) -> Tensor:
        """Xᵀ @ z."""
        if self._sparse is not None:
            return torch.from_numpy(self._sparse.T @ vectors.numpy())
        total = vectors.new_zeros(self._columns, vectors.shape[1])
        for column in self._index.T:
            total.index_add_(0, column, vectors)
        return total

"""The linear estimator on the identity map when there are many pairs: conjugate gradient on those that were visited."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from credit.interfaces import RewardModel
from credit.tensors import grown
from credit.types import FLOAT, Estimate, Positive, PositiveInt, Problem, Windows


class TableModel(RewardModel):
    """Tabular ridge reference (4) for thousands of pairs, batched over replicas and draws.

    (XᵀWX + λI)θ = XᵀWy is solved after every `observe` by conjugate gradient with a Jacobi preconditioner, from the
    last solution on. Only visited pairs have unknowns (θ is 0 elsewhere), and X is kept as its T indices a window:
    memory is O(K·(T + B) + visited pairs·B) a replica. A fit stops by itself, and so does not depend on its batch.

    Args:
        name: the model's name in metrics, files and figures.
        regularization: λ > 0.
        tolerance: relative residual at which a fit stops; 1e-2 goes stale.
        iterations: most iterations a solve.
    """

    domain: ClassVar = "tabular"

    def __init__(
        self,
        name: str = "ridge",
        regularization: Positive = 10.0,
        tolerance: Positive = 1e-4,
        iterations: PositiveInt = 200,
    ) -> None:
        self.name = name
        self.regularization = regularization
        self.tolerance = tolerance
        self.iterations = iterations

    def start(self, problem: Problem, draws: int) -> None:
        """No pair was visited."""
        self._problem = problem
        self._fits = 1 + draws
        self._forget()

    def _forget(self) -> None:
        problem = self._problem
        self._column = torch.full((problem.replicas * problem.pairs,), -1, device=problem.device)  # (r, s, a) → unknown
        self._pairs = torch.zeros(0, dtype=torch.int64, device=problem.device)  # unknown → (r, s, a)
        self._theta = torch.zeros(0, self._fits, dtype=FLOAT, device=problem.device)
        self._rows = 0
        self._index = torch.zeros(1, 0, problem.window, dtype=torch.int64, device=problem.device)
        self._weights = torch.zeros(1, 0, self._fits, dtype=FLOAT, device=problem.device)
        self._labels = torch.zeros(1, 0, 1, dtype=FLOAT, device=problem.device)

    def observe(self, windows: Windows, weights: Tensor) -> None:
        """Add windows [R, K, T] with weights [R, K, 1+B] and solve."""
        problem = self._problem
        offset = torch.arange(problem.replicas, device=problem.device).view(-1, 1, 1) * problem.pairs
        pairs = (windows.pairs(problem.actions) + offset).flatten(0, 1)
        fresh = torch.unique(pairs[self._column[pairs] < 0])
        self._column[fresh] = torch.arange(len(self._pairs), len(self._pairs) + len(fresh), device=problem.device)
        self._pairs = torch.cat([self._pairs, fresh])
        self._theta = torch.cat([self._theta, self._theta.new_zeros(len(fresh), self._fits)])
        before, self._rows = self._rows, self._rows + len(pairs)
        if self._rows > self._index.shape[1]:
            self._index, self._weights, self._labels = (
                grown(block, self._rows) for block in (self._index, self._weights, self._labels)
            )
        self._index[0, before : self._rows] = self._column[pairs]
        self._weights[0, before : self._rows] = weights.flatten(0, 1)
        self._labels[0, before : self._rows, 0] = windows.labels.flatten()
        self._solve()

    def refit(self, windows: Windows, weights: Tensor) -> None:
        """Forget everything and fit windows [R, K, T]; the last solution is the first guess."""
        known, theta = self._pairs, self._theta
        self._forget()
        self._column[known] = torch.arange(len(known), device=known.device)
        self._pairs, self._theta = known, theta
        self.observe(windows, weights)

    def estimate(self) -> Estimate:
        """θ for every pair: the point fit [R, N] and the B draws [R, B, N]."""
        problem = self._problem
        table = torch.zeros(self._fits, problem.replicas * problem.pairs, dtype=FLOAT, device=problem.device)
        table[:, self._pairs] = self._theta.T
        table = table.view(self._fits, problem.replicas, problem.pairs).transpose(0, 1)
        return Estimate(table[:, 0], table[:, 1:])

    def _solve(self) -> None:
        """Preconditioned conjugate gradient for all replicas and fits at once; a converged fit stands still."""
        design = Design(self._index[0, : self._rows], len(self._pairs))
        weights, labels = self._weights[0, : self._rows], self._labels[0, : self._rows]
        replica = self._pairs // self._problem.pairs
        shape = (self._problem.replicas, self._fits)

        def dot(first: Tensor, second: Tensor) -> Tensor:
            """Inner products of every replica and fit, [R, 1+B]."""
            return first.new_zeros(shape).index_add_(0, replica, first * second)

        target = design.transposed(weights * labels)
        diagonal = design.transposed(weights).add_(self.regularization)
        theta = self._theta
        residual = target - design.transposed(weights * design(theta)) - self.regularization * theta
        enough = self.tolerance**2 * dot(target, target)
        step = residual / diagonal
        energy = dot(residual, step)
        for _ in range(self.iterations):
            active = dot(residual, residual) > enough
            if not active.any():
                break
            image = design.transposed(weights * design(step)).add_(step, alpha=self.regularization)
            length = torch.where(active, energy / dot(step, image), 0.0)[replica]
            theta = torch.addcmul(theta, length, step)
            residual = torch.addcmul(residual, length, image, value=-1)
            scaled = residual / diagonal
            following = dot(residual, scaled)
            ratio = torch.where(active, following / energy, 0.0)[replica]
            step = torch.addcmul(scaled, ratio, step)
            energy = torch.where(active, following, energy)
        self._theta = theta


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

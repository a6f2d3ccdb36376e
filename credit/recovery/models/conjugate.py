"""Preconditioned conjugate gradient for the normal equations of windows: many fits at once, that differ in weights."""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor
from torch.nn.functional import embedding_bag

from credit.core.problem import FLOAT

TINY = 1e-30  # single precision's range ends at 1e-38


class Normal:
    """V = XᵀWX + λI, for vectors [V, F] with weights [rows, F] of their own."""

    def __init__(self, design: Design, weights: Tensor, regularization: float) -> None:
        self._design, self._weights, self._regularization = design, weights, regularization

    def __call__(self, vectors: Tensor) -> Tensor:
        """V @ v."""
        fitted = self._design(vectors).mul_(self._weights)
        return self._design.transposed(fitted).add_(vectors, alpha=self._regularization)

    def solve(self, residual: Tensor, inverse: Tensor, goal: Tensor, iterations: int) -> tuple[Tensor, int]:
        """x with V x = r, and the iterations it took; stops where rᵀM⁻¹r is below the goal [F], M⁻¹ = `inverse`."""
        solution = torch.zeros_like(residual)
        step = residual * inverse
        energy = (residual * step).sum(0)
        for taken in range(iterations):
            if not (energy > goal).any():
                return solution, taken
            image = self(step)
            length = energy / (step * image).sum(0).clamp_(min=TINY)  # 0 where a fit is solved to the last bit
            solution.addcmul_(length, step)
            residual.addcmul_(length, image, value=-1)
            scaled = residual * inverse
            following = (residual * scaled).sum(0)
            step.mul_(following / energy.clamp_(min=TINY)).add_(scaled)
            energy = following
        return solution, iterations


class Design:
    """X as T column indices a window: X @ v and Xᵀ @ z for v [V, F], z [rows, F].

    Args:
        index: [rows, T]. columns: V. none: a column that is zero whatever the index says, for windows with fewer
            steps; v is zero there.
    """

    def __init__(self, index: Tensor, columns: int, none: int | None = None) -> None:
        self._none = none
        rows, width = index.shape
        self._sparse: csr_array | None = None
        if index.device.type == "cpu":  # in double precision SciPy is several times faster here than torch
            cells = (np.ones(index.numel()), index.flatten().numpy(), np.arange(0, rows * width + 1, width))
            self._sparse = csr_array(cells, shape=(rows, columns))
            self._sparse_transposed = self._sparse.tocsc().T
            held, starts = self._sparse_transposed.indices, self._sparse_transposed.indptr
            self._held, self._starts = torch.from_numpy(held), torch.from_numpy(starts[:-1])
        else:
            self._held = index.flatten().argsort(stable=True) // width
            counts = torch.bincount(index.flatten(), minlength=columns)
            self._starts = counts.cumsum(0) - counts
        self._index = index.flatten().to(self._held.dtype)
        self._bags = torch.arange(0, rows * width, width, dtype=self._held.dtype, device=index.device)

    def __call__(self, vectors: Tensor) -> Tensor:
        """X @ v."""
        if self._sparse is not None and vectors.dtype == FLOAT:
            return torch.from_numpy(self._sparse @ vectors.numpy())
        return embedding_bag(self._index, vectors, self._bags, mode="sum")

    def transposed(self, vectors: Tensor) -> Tensor:
        """Xᵀ @ z."""
        if self._sparse is not None and vectors.dtype == FLOAT:
            found = torch.from_numpy(self._sparse_transposed @ vectors.numpy())
        else:
            found = embedding_bag(self._held, vectors, self._starts, mode="sum")
        if self._none is not None:
            found[self._none] = 0
        return found

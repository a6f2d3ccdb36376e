"""Linear algebra that gives a replica the same bits alone and in any batch."""

from __future__ import annotations

import torch
from torch import Tensor


def matvec(matrix: Tensor, vector: Tensor) -> Tensor:
    """Matrix [R, m, n] times vector [R, n] for every replica, [R, m].

    A batch of one takes another path through the BLAS, with other rounding; doubled, it takes the path of the rest.
    """
    if matrix.shape[0] == 1:
        return torch.bmm(matrix.expand(2, -1, -1), vector.expand(2, -1).unsqueeze(-1))[:1, :, 0]
    return torch.bmm(matrix, vector.unsqueeze(-1)).squeeze(-1)

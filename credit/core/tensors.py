"""Small tools on tensors with a leading replica dimension."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

CACHED = 2**18  # numbers that stay in a processor's cache from one operation to the next


def matvec(matrix: Tensor, vector: Tensor) -> Tensor:
    """Matrix [R, m, n] times vector [R, n] for every replica, [R, m]."""
    return torch.bmm(matrix, vector.unsqueeze(-1)).squeeze(-1)


def grown(block: Tensor, columns: int) -> Tensor:
    """The same values in a block [R, at least `columns`, ...], twice as long or more; zeros behind them."""
    larger = block.new_zeros(block.shape[0], max(columns, 2 * block.shape[1]), *block.shape[2:])
    larger[:, : block.shape[1]] = block
    return larger


def by_replica(function: Callable[..., Tensor], *tensors: Tensor) -> Tensor:
    """`function(*tensors)` for tensors [R, ...], in parts of R that stay in the cache where the whole would not."""
    replicas = len(tensors[0])
    size = max(1, CACHED * replicas // max(tensors[0].numel(), 1))
    if size >= replicas:
        return function(*tensors)
    return torch.cat([function(*parts) for parts in zip(*(tensor.split(size) for tensor in tensors), strict=True)])

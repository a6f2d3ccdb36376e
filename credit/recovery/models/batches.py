"""Windows for networks: a padded part of their steps, and which of them stand in a batch."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from credit.core.store import Windows


class Steps(NamedTuple):
    """P steps of each of K windows: their rows, and how many steps each stands for, 0 where it is padding.

    Attributes:
        rows: int64 [R, K, P]. weights: float32 [R, K, P]; those of a window sum to its length.
    """

    rows: Tensor
    weights: Tensor


def every(windows: Windows, stride: int, window: int) -> Steps:
    """Every stride-th step, counted back from the last one; each stands for those up to the one before it.

    Args:
        window: H. The padding depends on it alone: one shape, whatever came.
    """
    back = stride * torch.arange(padding(stride, window), device=windows.labels.device)
    weights = (windows.lengths.unsqueeze(-1) - back).clamp(0, stride).float()
    ends = windows.ends.unsqueeze(-1)
    return Steps(torch.where(weights > 0, ends - back, ends), weights)


def balanced(labels: Tensor, uniform: Tensor) -> Tensor:
    """Which trajectories stand in batches of B: the first half is drawn from successes, the second from failures.

    Args:
        labels: Y [M, K]; a success is one above zero. Where all are of one kind, both halves are drawn from all.
        uniform: numbers on [0, 1) [M, steps, B].

    Returns:
        Numbers of trajectories, int64 [M, steps, B].
    """
    count, success = labels.shape[1], labels > 0
    order = success.to(torch.int8).argsort(dim=1, descending=True, stable=True)  # successes first
    wins = success.sum(1).view(-1, 1, 1)
    mixed = (wins > 0) & (wins < count)
    first_half = torch.arange(uniform.shape[-1], device=labels.device) < uniform.shape[-1] // 2
    low = torch.where(mixed & ~first_half, wins, 0)
    high = torch.where(mixed & first_half, wins, count)
    place = low + (uniform * (high - low)).long()
    return order.gather(1, place.flatten(1)).view(place.shape)


def padding(stride: int, window: int) -> int:
    """P = ⌈H / stride⌉."""
    return -(-window // stride)

"""Trajectories for networks: a padded part of their steps, and which of them stand in a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from credit.streams import generators
from credit.trajectories import Trajectories


class Steps(NamedTuple):
    """P steps of each of K trajectories: their rows, and how many steps each stands for, 0 where it is padding.

    Attributes:
        rows: int64 [R, K, P]. weights: float32 [R, K, P]; those of a trajectory sum to its length.
    """

    rows: Tensor
    weights: Tensor


def every(trajectories: Trajectories, stride: int, window: int) -> Steps:
    """Every stride-th step, counted back from the last one; each stands for those up to the one before it.

    Args:
        window: H. The padding depends on it alone: one shape, whatever came.
    """
    ends = torch.zeros_like(trajectories.labels, dtype=torch.int64)
    (last,) = trajectories.final.nonzero(as_tuple=True)
    ends[trajectories.replica[last], trajectories.number[last]] = last
    back = stride * torch.arange(padding(stride, window), device=ends.device)
    weights = (trajectories.lengths.unsqueeze(-1) - back).clamp(0, stride).float()
    return Steps(torch.where(weights > 0, ends.unsqueeze(-1) - back, ends.unsqueeze(-1)), weights)


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


def side_by_side(seeds: Sequence[int], purpose: str, members: int) -> list[np.random.Generator]:
    """One generator for each of E networks of each replica, those of a replica together."""
    each = [generators(seeds, f"{purpose} {member}") for member in range(members)]
    return [generator for own in zip(*each, strict=True) for generator in own]

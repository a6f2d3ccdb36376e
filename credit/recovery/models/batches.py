"""Windows for networks: a padded part of their steps, and which of them stand in a batch."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from torch import Tensor

from credit.core.shapes import agree
from credit.core.windows import Windows

Balance = Literal["auto", "bits", "quantiles", "none"]


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
    return Steps(torch.where(weights > 0, ends - back, ends).clamp(min=0), weights)


def balanced(labels: Tensor, uniform: Tensor, balance: Balance = "auto", labelled: Tensor | None = None) -> Tensor:
    """Which windows stand in batches of B: the first half is drawn from the better ones, the second from the others.

    `bits`: labels are of two kinds, and those above the middle of the least and the largest are the better ones, so
    that a few successes among many failures are half of a batch. `quantiles`: the better ones are the upper half.
    `auto`: bits where labels take at most two values, else quantiles. `none`, and where all labels are the same: both
    halves are drawn from all.

    Args:
        labels: Y [M, K].
        uniform: numbers on [0, 1) [M, steps, B].
        balance: what makes two halves.
        labelled: which windows have a label [M, K], one at least of each; None for all. Others are not drawn.

    Returns:
        Numbers of windows, int64 [M, steps, B].
    """
    agree(labels=(labels, "M K"), uniform=(uniform, "M S B"))
    known = torch.ones_like(labels, dtype=torch.bool) if labelled is None else labelled
    count = known.sum(1, keepdim=True).unsqueeze(-1)
    least = torch.where(known, labels, torch.inf).amin(1, keepdim=True)
    largest = torch.where(known, labels, -torch.inf).amax(1, keepdim=True)
    better = known & (labels > least + (largest - least) / 2)
    two = ((labels == least) | (labels == largest) | ~known).all(1, keepdim=True)
    bits = two if balance == "auto" else torch.full_like(two, balance == "bits")
    value = torch.where(bits, better.to(labels.dtype), labels)
    order = torch.where(known, value, -torch.inf).argsort(dim=1, descending=True, stable=True)
    wins = torch.where(bits.unsqueeze(-1), better.sum(1, keepdim=True).unsqueeze(-1), count // 2)
    mixed = (largest > least).unsqueeze(-1) & (balance != "none")
    first_half = torch.arange(uniform.shape[-1], device=labels.device) < uniform.shape[-1] // 2
    low = torch.where(mixed & ~first_half, wins, 0)
    high = torch.where(mixed & first_half, wins, count)
    place = low + (uniform * (high - low)).long()
    return order.gather(1, place.flatten(1)).view(place.shape)


def padding(stride: int, window: int) -> int:
    """P = ⌈H / stride⌉."""
    return -(-window // stride)

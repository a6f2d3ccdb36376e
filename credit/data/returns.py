"""Discounted sums of rewards along the rows of a store, and how far they run."""

from __future__ import annotations

import torch
from torch import Tensor

from credit.core.windows import Windows


def episode_ends(windows: Windows, episodic: bool, start: int = 0) -> tuple[Tensor, Tensor]:
    """Where the episode of each row ends, for the rows from `start` on.

    Args:
        windows: n rows of each replica. episodic: whether windows that do not say where episodes end are episodes
            themselves, with nothing behind them; else the task goes on for ever.

    Returns:
        The last row of the episode, or of all that is known of it [R, n − start]; whether nothing lies behind a row.
    """
    rows, length = len(windows), windows.length
    here = torch.arange(start, rows, device=windows.labels.device).expand(len(windows.labels), -1)
    if windows.ended is None or windows.terminated is None:
        assert length is not None, "windows of different lengths say where episodes end"
        if episodic:
            return here - here % length + length - 1, here % length == length - 1
        return torch.full_like(here, rows - 1), torch.zeros_like(here, dtype=torch.bool)
    ended = windows.ended[:, start:]
    known = torch.where(ended, here, rows).flip(1).cummin(1).values.flip(1)
    count = torch.full_like(here[:, :1], rows) if windows.count is None else windows.count.unsqueeze(1)
    return torch.minimum(known, count - 1), windows.terminated[:, start:]


def discounted_sums(rewards: Tensor, last: Tensor, discount: float, most: int) -> Tensor:
    """Σ γᵏ r_{t+k} of at most so many rewards, up to the row `last` of each row t, in float64.

    Args:
        rewards: [R, n]. last: [R, m], for the last m of these rows.
    """
    start = rewards.shape[1] - last.shape[1]
    here = torch.arange(start, rewards.shape[1], device=rewards.device)
    total = torch.zeros_like(last, dtype=torch.float64)
    for k in range(min(most, int((last - here).max()) + 1)):
        behind = rewards[:, start + k :].double()
        size = behind.shape[1]
        total[:, :size] += torch.where(here[:size] + k <= last[:, :size], discount**k * behind, 0)
    return total


def discounted_sums_at(rewards: Tensor, rows: Tensor, last: Tensor, replica: Tensor | int, discount: float) -> Tensor:
    """The same sums from some rows [...] of a replica up to the rows `last` [...], in float64.

    Args:
        rewards: [R, n]. rows, last: where they begin and end. replica: whose, to be broadcast with them.
    """
    total = torch.zeros_like(rows, dtype=torch.float64)
    for k in range(int((last - rows).max()) + 1):
        here = (rows + k).clamp(max=rewards.shape[1] - 1)
        total += torch.where(rows + k <= last, discount**k * rewards[replica, here].double(), 0)
    return total

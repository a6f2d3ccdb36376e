"""Cells that no reward model tells apart need to be recovered only once: most of a large table was never visited."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

SMALL = 1_000  # cells; below it, sorting out which are alike costs more than it saves


class Alike:
    """Which cells stand for all of them: those that were visited, and one of each kind that was not.

    Args:
        looks: a number [N] for every cell from each model; where two unvisited cells have the same numbers from all
            models, all of them predict the same.
    """

    def __init__(self, looks: Sequence[Tensor]) -> None:
        _, self._kind = torch.unique(torch.stack(list(looks)), dim=1, return_inverse=True)
        self._kinds = int(self._kind.max()) + 1
        count = len(self._kind)
        self.saves = count >= SMALL and 2 * self._kinds <= count

    def choose(self, visits: Tensor) -> tuple[Tensor, Tensor]:
        """The chosen cells [R, n], and for every cell the column of the chosen one that stands for it [R, N].

        Args:
            visits: [R, N]. Replicas with fewer chosen cells than others are filled up with cell 0.
        """
        replicas, count = visits.shape
        seen = visits > 0
        cell = torch.arange(count, device=visits.device).expand(replicas, -1)
        kind = self._kind.expand(replicas, -1)
        # the first unvisited cell of each kind; kinds that were visited throughout get none
        first = torch.full((replicas, self._kinds), count, device=visits.device)
        first.scatter_reduce_(1, kind, cell.masked_fill(seen, count), "amin")
        chosen = seen | (first.gather(1, kind) == cell)
        rank = chosen.cumsum(1) - 1
        cells = torch.zeros(replicas, int(rank[:, -1].max()) + 1, dtype=torch.int64, device=visits.device)
        row, column = chosen.nonzero(as_tuple=True)
        cells[row, rank[row, column]] = column
        standing = torch.where(seen, cell, first.gather(1, kind))
        return cells, rank.gather(1, standing)


def spread_out(values: Tensor, position: Tensor) -> Tensor:
    """Values [R, ..., n] of the chosen cells, for all cells [R, ..., N]."""
    shape = (len(values), *[1] * (values.dim() - 2), position.shape[-1])
    return values.gather(-1, position.view(shape).expand(*values.shape[:-1], -1))

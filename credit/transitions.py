"""Transition models for planning."""

from __future__ import annotations

from typing import ClassVar, Literal

import torch
from torch import Tensor

from credit.interfaces import TransitionModel
from credit.types import FLOAT, NonNegative, Problem, Windows


class Counts(TransitionModel):
    """P̂(s'|s, a) = (N(s, a, s') + κ·prior(s'|s)) / (N(s, a) + κ).

    Where nothing was seen the prior decides, and with it whether an optimistic planner explores: `neighbour` spreads κ
    evenly over {s−1, s, s+1} (states on a line, reflecting), `self_loop` puts it on s, `uniform` on all states, and
    `zero` has none: rows of unvisited pairs are zero, N/max(1, N), to the letter of appendix C.

    Args:
        prior: where the pseudo-counts lie.
        pseudo_counts: κ, their number for each (s, a).
    """

    domain: ClassVar = "tabular"

    def __init__(
        self,
        prior: Literal["neighbour", "self_loop", "uniform", "zero"] = "neighbour",
        pseudo_counts: NonNegative = 1.0,
    ) -> None:
        self.prior = prior
        self.pseudo_counts = pseudo_counts

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts."""
        self._problem = problem
        size = problem.states
        rows = torch.zeros(size, size, dtype=FLOAT, device=problem.device)
        index = torch.arange(size, device=problem.device)
        if self.prior == "neighbour":
            for shift in (-1, 0, 1):
                rows[index, (index + shift).clamp(0, size - 1)] += 1 / 3
        elif self.prior == "self_loop":
            rows[index, index] = 1.0
        elif self.prior == "uniform":
            rows[:] = 1 / size
        start = (self.pseudo_counts * rows).unsqueeze(1).expand(size, problem.actions, size)
        self._counts = start.repeat(problem.replicas, 1, 1, 1)

    def observe(self, windows: Windows) -> None:
        """Count every step of new windows."""
        triples = windows.pairs(self._problem.actions) * self._problem.states + windows.next_states
        triples = triples.flatten(1)
        self._counts.flatten(1).scatter_add_(1, triples, torch.ones_like(triples, dtype=FLOAT))

    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]."""
        totals = self._counts.sum(-1, keepdim=True)
        return self._counts / totals.where(totals > 0, torch.ones_like(totals))

"""A structured surrogate for P where states lie on a line."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Positive
from credit.core.seams import TransitionTable
from credit.core.windows import Windows
from credit.envs.advertiser.environment import LineKnowledge
from credit.planning.counts import count, require_small


class ShiftMixture(TransitionTable):
    """Counts shrunk towards a structured estimate: on a line, an action moves the state by a law of its own.

    P̂(s'|s, a) = (N(s, a, s') + κ·P̃(s'|s, a)) / (N(s, a) + κ), where under P̃ the shift s' − s ∈ {−1, 0, 1} depends on a
    alone, is estimated from all states inside the line together, and reflects at its ends. It is for P what a
    surrogate is for r: low variance, and wrong where the structure is.

    Args:
        pseudo_counts: κ, visits to (s, a) after which its own counts weigh as much as the structure.
        shift_counts: pseudo-counts of each action's shift, spread evenly over the three.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    knows: ClassVar = LineKnowledge
    keeps: ClassVar = ("_counts", "_shifts")

    def __init__(self, pseudo_counts: Positive = 20.0, shift_counts: Positive = 1.0) -> None:
        self.pseudo_counts = pseudo_counts
        self.shift_counts = shift_counts

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts."""
        require_small(problem)
        self._problem = problem
        self._counts = problem.zeros(problem.states, problem.actions, problem.states)
        self._shifts = problem.zeros(problem.actions, 3) + self.shift_counts / 3
        states = torch.arange(problem.states, device=problem.device)
        ends = torch.stack([(states + move).clamp(0, problem.states - 1) for move in (-1, 0, 1)])
        self._moves = torch.nn.functional.one_hot(ends, problem.states).to(FLOAT)  # [3, S, S]

    def observe(self, windows: Windows) -> None:
        """Count every step for its pair, and for its action where both neighbours exist."""
        count(self._counts, windows, self._problem)
        shift = (windows.next_states - windows.states).clamp(-1, 1) + 1
        inside = (windows.states > 0) & (windows.states < self._problem.states - 1)
        index = windows.actions * 3 + shift
        self._shifts.flatten(1).scatter_add_(1, index.flatten(1), inside * windows.once)

    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]."""
        shifts = self._shifts / self._shifts.sum(-1, keepdim=True)
        structured = torch.einsum("ram,mst->rsat", shifts, self._moves)
        totals = self._counts.sum(-1, keepdim=True)
        return (self._counts + self.pseudo_counts * structured) / (totals + self.pseudo_counts)

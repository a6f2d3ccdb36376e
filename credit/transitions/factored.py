"""A structured surrogate for P in the sepsis simulator: vitals that move independently."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.envs.sepsis import ACTIONS, STATES, decode
from credit.transitions.counts import ObservedCounts
from credit.types import FLOAT, Positive, Problem, Windows

VITALS, LEVELS, TREATMENTS = 4, 3, 8
# A context is what one vital's move depends on: diabetes, current treatments, action, its own level.
CONTEXT = (2, TREATMENTS, ACTIONS, LEVELS)


class FactoredMixture(ObservedCounts):
    """Counts shrunk towards a factored estimate: each vital depends on its level, diabetes, treatments and the action.

    P̂ v = (N·mean of observed v(s') + κ·P̃ v)/(N + κ), where P̃ is a product over the four vitals of distributions that
    are estimated from all states which share the context; diabetes stays, the treatments of s' are the action. It is
    for P what a surrogate is for r; in this simulator the independence is exactly true.

    Args:
        pseudo_counts: κ, visits to (s, a) after which its own counts weigh as much as the structure.
        level_counts: pseudo-counts of each context, spread evenly over the three levels.
    """

    domain: ClassVar = "tabular"

    def __init__(self, pseudo_counts: Positive = 2.0, level_counts: Positive = 1.0) -> None:
        self.pseudo_counts = pseudo_counts
        self.level_counts = level_counts

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts."""
        super().start(problem)
        self._moves = problem.zeros(VITALS, *CONTEXT, LEVELS) + self.level_counts / LEVELS

    def observe(self, windows: Windows) -> None:
        """Count every step for its pair, and each vital's move for its context."""
        super().observe(windows)
        now, then = decode(windows.states), decode(windows.next_states)
        treatments = windows.states % TREATMENTS
        context = (now[..., 0] * TREATMENTS + treatments) * ACTIONS + windows.actions
        for vital in range(VITALS):
            index = (context * LEVELS + now[..., 1 + vital]) * LEVELS + then[..., 1 + vital]
            index = index.flatten(1)
            self._moves[:, vital].flatten(1).scatter_add_(1, index, torch.ones_like(index, dtype=FLOAT))

    def backup(self, values: Tensor) -> Tensor:
        """The mixture of both backups [R, S, A]."""
        visits = self._visits.view(-1, STATES, ACTIONS)
        own, structured = super().backup(values), self.structured(values)
        return (visits * own + self.pseudo_counts * structured) / (visits + self.pseudo_counts)

    def structured(self, values: Tensor) -> Tensor:
        """P̃ v [R, S, A] of values [R, S], averaged over one vital after the other; its level now takes its place."""
        chances = self._moves / self._moves.sum(-1, keepdim=True)
        ahead = values.view(-1, 2, *[LEVELS] * VITALS, ACTIONS).movedim(-1, 2).unsqueeze(2)  # [R, d, 1, a, 3, 3, 3, 3]
        for vital in reversed(range(VITALS)):
            move = chances[:, vital].view(-1, 2, TREATMENTS, ACTIONS, 1, 1, 1, LEVELS, LEVELS)
            ahead = (ahead.unsqueeze(-2) * move).sum(-1).movedim(-1, 4)
        return ahead.permute(0, 1, 4, 5, 6, 7, 2, 3).reshape(-1, STATES, ACTIONS)

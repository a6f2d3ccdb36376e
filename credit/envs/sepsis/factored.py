"""A structured surrogate for P in the sepsis simulator: vitals that move independently."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Positive, Probability
from credit.core.windows import Windows
from credit.envs.sepsis.environment import ACTIONS, STATES, SepsisKnowledge, decode, require_patients
from credit.planning.counts import ObservedCounts

VITALS, LEVELS, TREATMENTS = 4, 3, 8
PAIR = LEVELS**2
# A context is what one vital's move depends on: diabetes, current treatments, action, its own level.
CONTEXT = (2, TREATMENTS, ACTIONS, LEVELS)


class FactoredMixture(ObservedCounts):
    """Counts shrunk towards a factored estimate: each vital depends on its level, diabetes, treatments and the action.

    P̂ v = (N·mean of observed v(s') + κ·P̃ v)/(N + κ), where P̃ is a product over the four vitals of distributions that
    are estimated from all states which share the context; diabetes stays, the treatments of s' are the action. It is
    for P what a surrogate is for r; in this simulator the independence is exactly true.

    Args:
        pseudo_counts: κ, visits to (s, a) after which its own counts weigh as much as the structure.
        level_counts: pseudo-counts of each context.
        inertia: share of them that lies on the vital's own level, the rest is spread evenly. What is unknown then does
            little, as a self-loop would; spread evenly alone, an untried treatment looks dangerous and stays untried.
    """

    knows: ClassVar = SepsisKnowledge

    def __init__(self, pseudo_counts: Positive = 2.0, level_counts: Positive = 1.0, inertia: Probability = 0.9) -> None:
        self.pseudo_counts = pseudo_counts
        self.level_counts = level_counts
        self.inertia = inertia

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts.

        Raises:
            UserError: the states are no patients.
        """
        require_patients(type(self).__name__, problem)
        super().start(problem)
        self._moves = problem.zeros(VITALS, *CONTEXT, LEVELS)
        self._joint = self._pairs_of_vitals()

    def observe(self, windows: Windows) -> None:
        """Count every step for its pair, and each vital's move for its context."""
        super().observe(windows)
        now, then = decode(windows.states), decode(windows.next_states)
        treatments = windows.states % TREATMENTS
        context = (now[..., 0] * TREATMENTS + treatments) * ACTIONS + windows.actions
        for vital in range(VITALS):
            index = (context * LEVELS + now[..., 1 + vital]) * LEVELS + then[..., 1 + vital]
            index = index.flatten(1)
            self._moves[:, vital].flatten(1).scatter_add_(1, index, windows.once)
        self._joint = self._pairs_of_vitals()

    def state_dict(self) -> dict[str, Any]:
        """The observed transitions, and each vital's moves."""
        return super().state_dict() | {"moves": self._moves.cpu().clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Have seen these and no others."""
        super().load_state_dict(state)
        self._moves.copy_(state["moves"])
        self._joint = self._pairs_of_vitals()

    def backup(self, values: Tensor) -> Tensor:
        """The mixture of both backups [R, S, A]."""
        visits = self._visits.view(-1, STATES, ACTIONS)
        own, structured = super().backup(values), self.structured(values)
        return (visits * own + self.pseudo_counts * structured) / (visits + self.pseudo_counts)

    def structured(self, values: Tensor) -> Tensor:
        """P̃ v [R, S, A] of values [R, S]."""
        first, second = self._joint
        ahead = values.view(-1, 2, 1, PAIR, PAIR, ACTIONS).movedim(-1, 3)  # [R, d, 1, a, 9, 9]
        expected = first @ ahead @ second.mT  # [R, d, treatments, a, 9, 9]
        return expected.permute(0, 1, 4, 5, 2, 3).reshape(-1, STATES, ACTIONS)

    def _pairs_of_vitals(self) -> list[Tensor]:
        """How two vitals move together, [R, d, treatments, a, 9, 9], for the first two and for the last two."""
        prior = self.inertia * torch.eye(LEVELS, dtype=FLOAT) + (1 - self.inertia) / LEVELS
        counts = self._moves + self.level_counts * prior.to(self._moves.device)
        chances = counts / counts.sum(-1, keepdim=True)
        return [
            torch.einsum("...ij,...kl->...ikjl", chances[:, vital], chances[:, vital + 1]).flatten(-2).flatten(-3, -2)
            for vital in (0, 2)
        ]

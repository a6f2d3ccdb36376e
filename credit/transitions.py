"""Transition models for planning: counts, shrunk towards what is assumed where little was seen."""

from __future__ import annotations

from typing import ClassVar, Literal

import torch
from torch import Tensor

from credit.interfaces import TransitionModel, TransitionTable
from credit.tensors import grown
from credit.types import FLOAT, NonNegative, Positive, Problem, Windows


class Counts(TransitionTable):
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
        rows = prior_rows(self.prior, problem.states, problem.device)
        self._counts = problem.zeros(problem.states, problem.actions, problem.states)
        self._counts += self.pseudo_counts * rows.unsqueeze(1)

    def observe(self, windows: Windows) -> None:
        """Count every step of new windows."""
        _count(self._counts, windows, self._problem)

    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]."""
        totals = self._counts.sum(-1, keepdim=True)
        return self._counts / totals.where(totals > 0, torch.ones_like(totals))


class ShiftMixture(TransitionTable):
    """Counts shrunk towards a structured estimate: on a line, an action moves the state by a law of its own.

    P̂(s'|s, a) = (N(s, a, s') + κ·P̃(s'|s, a)) / (N(s, a) + κ), where under P̃ the shift s' − s ∈ {−1, 0, 1} depends on a
    alone, is estimated from all states inside the line together, and reflects at its ends. It is for P what a
    surrogate is for r: low variance, and wrong where the structure is.

    Args:
        pseudo_counts: κ, visits to (s, a) after which its own counts weigh as much as the structure.
        shift_counts: pseudo-counts of each action's shift, spread evenly over the three.
    """

    domain: ClassVar = "tabular"

    def __init__(self, pseudo_counts: Positive = 20.0, shift_counts: Positive = 1.0) -> None:
        self.pseudo_counts = pseudo_counts
        self.shift_counts = shift_counts

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts."""
        self._problem = problem
        self._counts = problem.zeros(problem.states, problem.actions, problem.states)
        self._shifts = problem.zeros(problem.actions, 3) + self.shift_counts / 3
        states = torch.arange(problem.states, device=problem.device)
        ends = torch.stack([(states + move).clamp(0, problem.states - 1) for move in (-1, 0, 1)])
        self._moves = torch.nn.functional.one_hot(ends, problem.states).to(FLOAT)  # [3, S, S]

    def observe(self, windows: Windows) -> None:
        """Count every step for its pair, and for its action where both neighbours exist."""
        _count(self._counts, windows, self._problem)
        shift = (windows.next_states - windows.states).clamp(-1, 1) + 1
        inside = (windows.states > 0) & (windows.states < self._problem.states - 1)
        index = windows.actions * 3 + shift
        self._shifts.flatten(1).scatter_add_(1, index.flatten(1), inside.flatten(1).to(FLOAT))

    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]."""
        shifts = self._shifts / self._shifts.sum(-1, keepdim=True)
        structured = torch.einsum("ram,mst->rsat", shifts, self._moves)
        totals = self._counts.sum(-1, keepdim=True)
        return (self._counts + self.pseudo_counts * structured) / (totals + self.pseudo_counts)


def prior_rows(prior: str, states: int, device: torch.device) -> Tensor:
    """Where a prior of `Counts` expects the next state, [S, S]."""
    rows = torch.zeros(states, states, dtype=FLOAT, device=device)
    index = torch.arange(states, device=device)
    if prior == "neighbour":
        for shift in (-1, 0, 1):
            rows[index, (index + shift).clamp(0, states - 1)] += 1 / 3
    elif prior == "self_loop":
        rows[index, index] = 1.0
    elif prior == "uniform":
        rows[:] = 1 / states
    return rows


def _count(counts: Tensor, windows: Windows, problem: Problem) -> None:
    triples = (windows.pairs(problem.actions) * problem.states + windows.next_states).flatten(1)
    counts.flatten(1).scatter_add_(1, triples, torch.ones_like(triples, dtype=FLOAT))


class ObservedCounts(TransitionModel):
    """P̂(s'|s, a) = N(s, a, s')/max(1, N(s, a)) to the letter of appendix C, for problems too large to write P̂ out.

    What is stored are the observed transitions; a backup costs O(transitions so far), whatever S is.
    """

    domain: ClassVar = "tabular"

    def start(self, problem: Problem) -> None:
        """No transition was seen."""
        self._problem = problem
        self._seen = 0
        self._pairs = torch.zeros(problem.replicas, 1, dtype=torch.int64, device=problem.device)
        self._arrivals = torch.zeros_like(self._pairs)
        self._visits = problem.zeros(problem.pairs)

    def observe(self, windows: Windows) -> None:
        """Store every step of new windows."""
        pairs = windows.pairs(self._problem.actions).flatten(1)
        before, self._seen = self._seen, self._seen + pairs.shape[1]
        if self._seen > self._pairs.shape[1]:
            self._pairs, self._arrivals = grown(self._pairs, self._seen), grown(self._arrivals, self._seen)
        self._pairs[:, before : self._seen] = pairs
        self._arrivals[:, before : self._seen] = windows.next_states.flatten(1)
        self._visits.scatter_add_(1, pairs, torch.ones_like(pairs, dtype=FLOAT))

    def backup(self, values: Tensor) -> Tensor:
        """The mean value of the observed successors, 0 where there is none, [R, S, A]."""
        ahead = values.gather(1, self._arrivals[:, : self._seen])
        total = torch.zeros_like(self._visits).scatter_add_(1, self._pairs[:, : self._seen], ahead)
        return (total / self._visits.clamp(min=1)).view(-1, self._problem.states, self._problem.actions)

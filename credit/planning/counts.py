"""Counted transitions, as the paper has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import NonNegative
from credit.core.seams import Transition, TransitionTable
from credit.core.tensors import grown
from credit.core.windows import Windows

LARGEST = 1_000_000  # entries of P̂


class Counts(TransitionTable):
    """P̂(s'|s, a) = (N(s, a, s') + κ·prior(s'|s)) / (N(s, a) + κ).

    Where nothing was seen the prior decides, and with it whether an optimistic planner explores: `neighbour` spreads κ
    evenly over {s−1, s, s+1} (states on a line, reflecting), `self_loop` puts it on s, `uniform` on all states, and
    `zero` has none: rows of unvisited pairs are zero, N/max(1, N), to the letter of appendix C.

    Args:
        prior: where the pseudo-counts lie.
        pseudo_counts: κ, their number for each (s, a).
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    keeps: ClassVar = ("_counts",)

    def __init__(
        self,
        prior: Literal["neighbour", "self_loop", "uniform", "zero"] = "neighbour",
        pseudo_counts: NonNegative = 1.0,
    ) -> None:
        self.prior = prior
        self.pseudo_counts = pseudo_counts

    def start(self, problem: Problem) -> None:
        """Only the pseudo-counts."""
        require_small(problem)
        self._problem = problem
        rows = prior_rows(self.prior, problem.states, problem.device)
        self._counts = problem.zeros(problem.states, problem.actions, problem.states)
        self._counts += self.pseudo_counts * rows.unsqueeze(1)

    def observe(self, windows: Windows) -> None:
        """Count every step of new windows."""
        count(self._counts, windows, self._problem)

    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]."""
        return self._counts / self._counts.sum(-1, keepdim=True).clamp(min=torch.finfo(FLOAT).tiny)  # 0 of 0 is 0


class ObservedCounts(Transition):
    """P̂(s'|s, a) = N(s, a, s')/max(1, N(s, a)) to the letter of appendix C, for problems too large to write P̂ out.

    What is stored are the different observed transitions; a backup costs O(their number), whatever S is.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"

    def start(self, problem: Problem) -> None:
        """No transition was seen."""
        self._problem = problem
        self._columns: list[dict[int, int]] = [{} for _ in problem.seeds]  # (s, a, s') → column of the three below
        self._pairs = torch.zeros(problem.replicas, 256, dtype=torch.int64, device=problem.device)
        self._arrivals = torch.zeros_like(self._pairs)
        self._times = problem.zeros(256)
        self._visits = problem.zeros(problem.pairs)
        self._seen = 0

    def observe(self, windows: Windows) -> None:
        """Count every step of new windows."""
        pairs, arrivals = windows.pairs(self._problem.actions), windows.next_states
        triples = (pairs * self._problem.states + arrivals).tolist()
        counts = [len(windows)] * len(triples) if windows.count is None else windows.count.tolist()
        held = zip(self._columns, triples, counts, strict=True)
        places = [[columns.setdefault(triple, len(columns)) for triple in own[:count]] for columns, own, count in held]
        self._seen = seen = max(map(len, self._columns))
        if seen >= self._pairs.shape[1]:
            self._pairs, self._arrivals = grown(self._pairs, seen + 1), grown(self._arrivals, seen + 1)
            self._times = grown(self._times, seen + 1)
        padded = [own + [seen] * (len(windows) - len(own)) for own in places]  # a column that nobody reads
        column, once = torch.tensor(padded, device=pairs.device), windows.once
        self._pairs.scatter_(1, column, pairs)
        self._arrivals.scatter_(1, column, arrivals)
        self._times.scatter_add_(1, column, once)
        self._visits.scatter_add_(1, pairs, once)

    def state_dict(self) -> dict[str, Any]:
        """The observed transitions."""
        observed = torch.stack([part[:, : self._seen].to(FLOAT) for part in (self._pairs, self._arrivals, self._times)])
        return {"observed": observed.cpu()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Have seen these transitions and no others."""
        pairs, arrivals, times = state["observed"].to(self._times.device)
        self._seen = seen = times.shape[1]
        self._pairs, self._arrivals = grown(self._pairs, seen), grown(self._arrivals, seen)
        self._times = grown(self._times, seen)
        self._pairs[:, :seen], self._arrivals[:, :seen], self._times[:, :seen] = pairs, arrivals, times
        self._visits.zero_().scatter_add_(1, self._pairs[:, :seen], times)
        triples = (pairs * self._problem.states + arrivals).long().tolist()
        counts = (times > 0).sum(1).tolist()
        self._columns = [
            {triple: column for column, triple in enumerate(of_replica[:count])}
            for of_replica, count in zip(triples, counts, strict=True)
        ]

    def backup(self, values: Tensor) -> Tensor:
        """The mean value of the observed successors, 0 where there is none, [R, S, A]."""
        ahead = values.gather(1, self._arrivals[:, : self._seen]) * self._times[:, : self._seen]
        total = torch.zeros_like(self._visits).scatter_add_(1, self._pairs[:, : self._seen], ahead)
        return (total / self._visits.clamp(min=1)).view(-1, self._problem.states, self._problem.actions)


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


def require_small(problem: Problem) -> None:
    """Refuse to write P̂ out where it would fill the memory.

    Raises:
        UserError: S·A·S is above a million.
    """
    size = problem.pairs * problem.states
    if size > LARGEST:
        raise UserError(
            f"transition: P̂ of {problem.states} states and {problem.actions} actions has {size} entries a replica, at "
            f"most {LARGEST} are written out; choose transition=observed_counts or transition=mixture"
        )


def count(counts: Tensor, windows: Windows, problem: Problem) -> None:
    """Add the steps of windows to counts [R, S, A, S], in place."""
    triples = windows.pairs(problem.actions) * problem.states + windows.next_states
    counts.flatten(1).scatter_add_(1, triples, windows.once)

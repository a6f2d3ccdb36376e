"""What environments share whose MDP is known exactly."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Protocol

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Environment, Transitions
from credit.core.streams import Stream


class ExactMDP(Protocol):
    """An MDP with S states and A actions."""

    @property
    def states(self) -> int:
        """S."""

    @property
    def actions(self) -> int:
        """A."""

    @property
    def initial(self) -> Tensor:
        """The initial distribution [S]."""

    @property
    def transitions(self) -> KnownTransitions:
        """P alone."""


class ExactEnvironment(Environment):
    """Copies of one exact MDP, stepped together; by default one of each replica."""

    copies = 1
    ends_early: ClassVar = False
    keeps: ClassVar[tuple[str, ...]] = ("_stream", "_first", "_states", "_numbers", "_used")

    @property
    @abstractmethod
    def mdp(self) -> ExactMDP:
        """The exact MDP."""

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        """S, A, T and the seeds."""
        episodic = self.setting == "episodic"
        return Problem.finite(self.mdp.states, self.mdp.actions, window, seeds, device, episodic)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        """Make the streams of K copies of R replicas."""
        self._actions, self._window = problem.actions, problem.window
        self._initial = cumulative(self.mdp.initial).to(problem.device)
        first = "initial state" if purpose == "environment" else f"initial state, {purpose}"
        self._stream = Stream(problem, purpose, "uniform", copies * problem.window)
        self._first = Stream(problem, first, "uniform", copies)
        self._states = torch.zeros(problem.replicas, copies, dtype=torch.int64, device=problem.device)
        self._numbers: tuple[Tensor, ...] = ()  # of a window, [R, K, 1] a step
        self._used = problem.window

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """Draw initial states."""
        drawn = torch.searchsorted(self._initial, self._first.next(), right=True)
        if mask is None:
            self._states, self._used = drawn, self._window
        else:
            self._states = torch.where(mask, drawn, self._states)
        return self._states

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        """Draw s' from P(·|s, a)."""
        if self._used == self._window:
            numbers = self._stream.next().view(*self._states.shape, -1, 1)
            self._numbers = numbers.movedim(2, 0).contiguous().unbind()
            self._used = 0
        row = torch.add(actions, self._states, alpha=self._actions)
        states, rewards = self._draw(row, self._numbers[self._used])
        self._used += 1
        self._states = states if mask is None else torch.where(mask, states, self._states)
        return Transitions(self._states, rewards)

    @abstractmethod
    def _draw(self, row: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        """s' [R, K] and r [R, K] of rows s·A + a [R, K], from uniform numbers [R, K, 1]."""

    def knowledge(self) -> KnownTransitions:
        """P, for oracles."""
        return self.mdp.transitions


def require_distributions(rows: Tensor, initial: Tensor) -> None:
    """Refuse what is no distribution.

    Args:
        rows: P of row s·A + a, over any lists of successors [S·A, W]. initial: [S].

    Raises:
        UserError: names the row, and what its entries are.
    """
    for row in _not_distributions(rows)[:1].tolist():
        entries, actions = rows[row], len(rows) // len(initial)
        raise UserError(
            f"transition row (s={row // actions}, a={row % actions}) is no distribution: its entries "
            f"go from {float(entries.min()):.6g} to {float(entries.max()):.6g} and have the sum "
            f"{float(entries.sum()):.6g}; they must lie in [0, 1] and sum to 1"
        )
    if len(_not_distributions(initial.unsqueeze(0))):
        raise UserError(
            f"the initial distribution has the least entry {float(initial.min()):.6g} and the sum "
            f"{float(initial.sum()):.6g}; entries must lie in [0, 1] and sum to 1"
        )


def _not_distributions(rows: Tensor) -> Tensor:
    return (((rows.sum(-1) - 1).abs() > 1e-9) | (rows < 0).any(-1)).nonzero().flatten()


def successor(cumulative: Tensor, uniform: Tensor) -> Tensor:
    """Which entry [...] of distributions with running sums [..., n] uniform numbers [..., 1] fall into."""
    return torch.searchsorted(cumulative, uniform, right=True).squeeze(-1)


def cumulative(rows: Tensor) -> Tensor:
    """Running sums of distributions [..., n], infinite from the last possible entry on: rounding leads past none."""
    width = rows.shape[-1]
    last = width - 1 - (rows > 0).flip(-1).to(torch.uint8).argmax(-1, keepdim=True)
    return rows.to(FLOAT).cumsum(-1).masked_fill(torch.arange(width) >= last, torch.inf)

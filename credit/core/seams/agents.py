"""Relabelled rewards → policy: agents, and the transition models that planners plan with."""

from __future__ import annotations

from abc import abstractmethod

from torch import Tensor

from credit.core.component import Component
from credit.core.policy import Policy
from credit.core.problem import Problem
from credit.core.seams.recovery import CreditAssigner
from credit.core.store import Store
from credit.core.tensors import matvec
from credit.core.windows import Windows


class Agent(Component):
    """The policy optimizer that consumes relabelled rewards.

    Every finished run keeps what acts: tables, where all `policies` are `TablePolicy`; else the part of the state that
    policies look at (`acts`; without it all but optimizers, random numbers and credit's replay). A seed's own part of
    it is taken out, so tensors begin with R, or stand in a list of R. Laid over the state of an agent that was just
    started, its policies must do what those of the run did.
    """

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the policies of R replicas."""

    @abstractmethod
    def act(self, states: Tensor, step: Tensor) -> Tensor:
        """Actions of K copies of each replica [R, K, ...], as a `Policy` has them; may explore."""

    @abstractmethod
    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        """Learn from the newest windows, or plan with what is believed."""

    @abstractmethod
    def policies(self) -> dict[str, Policy]:
        """`behaviour` and, where there are others to judge, those: without bonus (`greedy`), averaged, …"""

    def executed(self) -> Policy:
        """What `act` follows now, exploration included; by default the behaviour."""
        return self.policies()["behaviour"]

    @property
    def newest(self) -> bool:
        """Whether it learns from steps of the newest round alone, and forgets them."""
        return False

    def table(self) -> Tensor | None:
        """One action for every state [R, S], where to look it up is all that `act` does until `improve`; else None."""
        return None

    def diagnostics(self) -> dict[str, Tensor]:
        """What the last improvement came to: name → [R], for the journal; nothing by default."""
        return {}


class Transition(Component):
    """P̂ for planning."""

    @abstractmethod
    def start(self, problem: Problem) -> None:
        """Make the counts of R replicas."""

    @abstractmethod
    def observe(self, windows: Windows) -> None:
        """Count new transitions."""

    @abstractmethod
    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A] of values [R, S]."""


class TransitionTable(Transition):
    """A transition model that is small enough to be written out."""

    @abstractmethod
    def probabilities(self) -> Tensor:
        """P̂ [R, S, A, S]; rows sum to one, or to zero where nothing is known and nothing assumed."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P̂(s'|s, a) v(s') [R, S, A]."""
        probabilities = self.probabilities()
        return matvec(probabilities.flatten(1, 2), values).view(probabilities.shape[:-1])

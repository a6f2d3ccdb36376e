"""The true transitions: not a learner, but how much of the regret is due to an estimated P."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import Transition
from credit.core.store import Windows


@runtime_checkable
class KnownTransitions(Protocol):
    """Knowledge of an environment whose P is known."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P(s'|s, a) v(s') [..., S, A] of values [..., S]."""


class Exact(Transition):
    """P itself, told by the environment: an oracle for planners."""

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    setting: ClassVar = "episodic"
    knows: ClassVar = KnownTransitions
    keeps: ClassVar = ()

    def learn(self, knowledge: KnownTransitions) -> None:
        """Be told P."""
        self._known = knowledge

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def observe(self, windows: Windows) -> None:
        """Nothing to learn."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P(s'|s, a) v(s') [R, S, A]."""
        return self._known.backup(values).to(values.device)

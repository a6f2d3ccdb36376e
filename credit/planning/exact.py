"""The true transitions: not a learner, but how much of the regret is due to an estimated P."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor

from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import Problem
from credit.core.seams import Transition
from credit.core.windows import Windows


class Exact(Transition):
    """P itself, as the environment knows it: an oracle for planners."""

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    setting: ClassVar = "episodic"
    knows: ClassVar = KnownTransitions
    keeps: ClassVar = ()
    _known: KnownTransitions | None = None

    def learn(self, knowledge: KnownTransitions) -> None:
        """Take P."""
        self._known = knowledge

    def start(self, problem: Problem) -> None:
        """Nothing to estimate.

        Raises:
            UserError: nobody told it P.
        """
        if self._known is None:
            raise UserError("transition=exact knows nothing yet: call learn(env.knowledge()) before start")

    def observe(self, windows: Windows) -> None:
        """Nothing to estimate."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P(s'|s, a) v(s') [R, S, A]."""
        assert self._known is not None
        return self._known.backup(values).to(values.device)

"""What agents with an encoder have in common."""

from __future__ import annotations

from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import Encoder
from credit.core.state import Stateful
from credit.core.windows import Windows


class Seeing(Stateful):
    """Something with networks that may see states through an encoder.

    Attributes:
        encoder: that; None for states as they are.
    """

    encoder: Encoder | None

    def seen(self, states: Tensor) -> Tensor:
        """What networks see of states [R, n, ...]; of vectors [n, O] that are the same for all replicas, [R, n, O]."""
        return states if self.encoder is None else self.encoder(states)

    def open_eyes(self, problem: Problem) -> None:
        """Start the encoder."""
        if self.encoder is not None:
            self.encoder.start(problem)

    def look(self, windows: Windows) -> None:
        """Show the encoder new training steps."""
        if self.encoder is not None:
            self.encoder.observe(windows)

    def _looked_at(self) -> tuple[str, ...]:
        return super()._looked_at() if self.encoder is None or self.acts is None else (*super()._looked_at(), "encoder")

    def _names(self) -> tuple[str, ...]:
        """The encoder's state is kept with that of whatever sees through it."""
        return super()._names() if self.encoder is None else (*super()._names(), "encoder")

"""The oracle's reward model for steps: it is shown what nobody else sees, and says it again."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.continuous import StepModel
from credit.core.interfaces import FeatureMap
from credit.core.trajectories import ContinuousProblem, Moves, Trajectories


class StepPrimitive(StepModel):
    """The primitive reward of every step that was taken, without variance: a ceiling, not a learner.

    Args:
        name: the model's name in metrics, files and figures.
    """

    sees_primitive: ClassVar = True

    def __init__(self, name: str = "primitive") -> None:
        self.name = name
        self.features = Nothing()

    def start(self, problem: ContinuousProblem) -> None:
        """Nothing to make."""

    def fit(self, inputs: Tensor, trajectories: Trajectories) -> None:
        """Nothing to learn.

        Raises:
            ValueError: the trajectories do not show their primitive reward.
        """
        if trajectories.primitive is None:
            raise ValueError("the primitive reward was not shown to the oracle")

    def predict(self, inputs: Tensor, moves: Moves) -> tuple[Tensor, Tensor]:
        """r [N] float32, NaN where it is not known (steps that were not taken), and zero variance [N]."""
        shown = moves.primitive if isinstance(moves, Trajectories) else None
        mean = torch.full((len(moves),), torch.nan, device=moves.states.device) if shown is None else shown.float()
        return mean, torch.zeros_like(mean)


class Nothing(FeatureMap):
    """No features [N, 0]."""

    domain: ClassVar = "continuous"

    def start(self, problem: ContinuousProblem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        """Rows without numbers."""
        return steps.states[:, :0]

"""What a body does: its state and its action, as they are."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.interfaces import FeatureMap
from credit.core.trajectories import ContinuousProblem, Moves


class Motion(FeatureMap):
    """State and action side by side, (x, y, vx, vy, ax, ay) in a maze: what the DNN reference looks at (3.2)."""

    domain: ClassVar = "continuous"

    def start(self, problem: ContinuousProblem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        """Rows [N, O + A], float32."""
        return torch.cat([steps.states, steps.actions], -1).float()

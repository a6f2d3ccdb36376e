"""What a body does: its state and its action, as they are."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps


class Motion(FeatureMap):
    """State and action side by side, (x, y, vx, vy, ax, ay) in a maze: what the DNN reference looks at (3.2)."""

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """Rows [N, O + A], float32."""
        return torch.cat([steps.states, steps.actions], -1).float()

"""What a body does: its state and its action, as they are."""

from __future__ import annotations

from typing import ClassVar

from credit.recovery.features.flat import Flat


class Motion(Flat):
    """State and action side by side, (x, y, vx, vy, ax, ay) in a maze: what the DNN reference looks at (3.2)."""

    observations: ClassVar = "vector"
    actions: ClassVar = "vector"

"""The intercepts of networks that are fitted to log-odds: what belongs to no step."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.state import Stateful
from credit.networks.adam import Adam
from credit.recovery.models.batches import Balance
from credit.recovery.models.logistic import drawn_odds


class Intercepts(Stateful):
    """b of each of M networks, fitted by Adam together with them.

    In training the odds with which batches are drawn are added, so that b is that of all windows.

    Attributes:
        values: b [M].
    """

    keeps: ClassVar = ("values", "_adam")

    def __init__(self, members: int, learning_rate: float, device: torch.device) -> None:
        self.values, self._gradient, self._drawn = torch.zeros(3, members, device=device).unbind()
        self._adam = Adam(self.values, self._gradient, learning_rate)

    def look(self, labels: Tensor, labelled: Tensor | None, batch: int, balance: Balance) -> None:
        """Take note of how batches are drawn from labels [M, K]."""
        self._drawn = drawn_odds(labels, labelled, batch, balance in ("auto", "bits"))

    def of(self, networks: Tensor) -> Tensor:
        """b, and the odds of being drawn, for numbers of networks [n]."""
        return (self.values + self._drawn)[networks]

    def step(self, gradient: Tensor) -> None:
        """One step with the gradient [M]."""
        self._gradient.copy_(gradient)
        self._adam.step()

"""Networks that YAML can name: perceptrons, or a user's own."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Literal

import torch
from torch import nn
from torchrl.modules import MLP

from credit.core.component import Component
from credit.core.ranges import PositiveInt

Activation = Literal["relu", "tanh", "elu", "gelu"]
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "tanh": nn.Tanh, "elu": nn.ELU, "gelu": nn.GELU}


class Network(Component):
    """What makes the networks of an agent: actor, critics and values are one each.

    Example: one's own, in a package that has an entry point in the group `credit.components`; YAML names it by
    `network: {_target_: package.module.Wide}`.
        >>> class Wide(Network):
        ...     def make(self, inputs, outputs, device):
        ...         return MyModule(inputs, outputs).to(device)
    """

    @abstractmethod
    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        """A network with fresh weights, drawn from PyTorch's global generator: [..., inputs] → [..., outputs]."""


class Perceptron(Network):
    """A multi-layer perceptron.

    Args:
        hidden: widths of the layers between input and output. activation: between them.
    """

    def __init__(self, hidden: Sequence[PositiveInt] = (64, 64), activation: Activation = "tanh") -> None:
        self.hidden, self.activation = tuple(hidden), activation

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        """With PyTorch's initial weights."""
        kind = ACTIVATIONS[self.activation]
        network: nn.Module = MLP(inputs, outputs, num_cells=list(self.hidden), activation_class=kind, device=device)
        return network

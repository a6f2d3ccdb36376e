"""Modules of anybody side by side, with what a `Stack` of perceptrons has: flat weights, and passes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.state import Stateful
from credit.networks.modules import Network
from credit.networks.replicated import Replicated
from credit.networks.seeding import seeded


class Modules(Stateful):
    """N modules of one kind and one output each, by autograd, their weights in one flat tensor.

    Args:
        network: makes them. inputs: numbers that go into each. streams: one generator a module, for its first weights.
        device: where they are.

    Attributes:
        inputs: numbers that go into each. weights: the parameters [N, …]. flat: all of them, of which blocks are views.
    """

    keeps: ClassVar = ("flat",)

    def __init__(
        self, network: Network, inputs: int, streams: Sequence[np.random.Generator], device: torch.device
    ) -> None:
        self._network, self.inputs = network, inputs
        made = []
        for stream in streams:
            with seeded(int(stream.integers(2**63)), device):
                made.append(network.make(inputs, 1, device))
        self._modules = Replicated(made, inputs)
        self.weights = list(self._modules.parameters())
        self.flat = torch.cat([weight.detach().flatten() for weight in self.weights])
        self.blocks = self.views(self.flat)
        for weight, view in zip(self.weights, self.blocks, strict=True):
            weight.data = view

    @property
    def members(self) -> int:
        """N."""
        return len(self.blocks[0])

    @property
    def loops(self) -> bool:
        """Whether `torch.func` does not carry them, so that they run one after the other."""
        return self._modules.loops

    def another(self, streams: Sequence[np.random.Generator]) -> Modules:
        """As many of the same kind, with first weights of their own."""
        return Modules(self._network, self.inputs, streams, self.flat.device)

    def passes(self, rows: int) -> Graph:
        """What trains them, on so many rows of each at a time."""
        return Graph(self, rows)

    def outputs(self, rows: Tensor) -> Tensor:
        """Of each [N, rows, 1] for rows of its own [N, rows, in], with the graph behind them."""
        found: Tensor = self._modules(rows)
        return found

    def alone(self, m: int, rows: Tensor) -> Tensor:
        """The outputs [n] of one for rows [n, in]."""
        with torch.no_grad():
            return self._modules.alone(m, rows).squeeze(-1)

    def views(self, flat: Tensor) -> list[Tensor]:
        """Parts of a flat tensor, in the shapes of the weights."""
        sizes = [math.prod(weight.shape) for weight in self.weights]
        return [part.view(w.shape) for part, w in zip(flat.split(sizes), self.weights, strict=True)]


class Graph:
    """Forward and backward passes of modules, by autograd.

    Attributes:
        input: [N, rows, in], for the caller to fill. gradient: by all weights, flat.
    """

    def __init__(self, modules: Modules, rows: int) -> None:
        self._modules = modules
        self.input = torch.empty(modules.members, rows, modules.inputs, device=modules.flat.device)
        self.gradient = torch.zeros_like(modules.flat)
        self._views = modules.views(self.gradient)

    def forward(self, masks: Sequence[Tensor] = ()) -> Tensor:
        """The outputs [N, rows, 1]; modules of anybody know no masks."""
        with torch.enable_grad():
            self._outputs = self._modules.outputs(self.input)
        return self._outputs.detach()

    def backward(self, delta: Tensor) -> None:
        """Write the gradient, where that by the outputs is delta [N, rows, 1]."""
        found = torch.autograd.grad(self._outputs, self._modules.weights, delta, allow_unused=True)
        for view, gradient in zip(self._views, found, strict=True):
            view.zero_() if gradient is None else view.copy_(gradient)

"""Networks that YAML can name: perceptrons, or any module."""

from __future__ import annotations

import importlib
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import nn

from credit.core.component import Component
from credit.core.errors import UserError
from credit.core.ranges import PositiveInt

Activation = Literal["relu", "tanh", "elu", "gelu"]
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "tanh": nn.Tanh, "elu": nn.ELU, "gelu": nn.GELU}


class Network(Component):
    """What makes the networks of an agent: actor, critics and values are one each.

    Agents and reward models put them in evaluation mode and leave them there, in gradient steps, too: dropout does
    nothing, and batch norms keep their first statistics. A layer norm is what scales on small, changing batches.

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
        from torchrl.modules import MLP  # which takes seconds to import, and reward models name this module

        kind = ACTIVATIONS[self.activation]
        network: nn.Module = MLP(inputs, outputs, num_cells=list(self.hidden), activation_class=kind, device=device)
        return network


class Module(Network):
    """A module by its name, made as `Class(inputs, outputs, **keys)`: sizes of what goes in and comes out.

    Args:
        module: package.module:Class. keys: what else its constructor is given.

    Raises:
        UserError: there is no such class, or it is no `torch.nn.Module`; when networks are made: it cannot be.

    Example:
        >>> Module("torchrl.modules:MLP", {"num_cells": [32, 32]})
    """

    def __init__(self, module: str, keys: Mapping[str, Any] | None = None) -> None:
        self.module, self.keys = module, dict(keys or {})
        package, _, name = module.rpartition(":")
        try:
            self._cls = getattr(importlib.import_module(package), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise UserError(f"network.module={module!r}: give package.module:Class; {error}") from None
        if not (isinstance(self._cls, type) and issubclass(self._cls, nn.Module)):
            raise UserError(f"network.module={module!r}: it is no class of torch.nn.Module; give one that is")

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        """With the weights that it gives itself, in evaluation mode."""
        try:
            made: nn.Module = self._cls(inputs, outputs, **self.keys)
            shape = made.to(device).eval()(torch.zeros(2, inputs, device=device)).shape
        except Exception as error:  # whatever somebody's module may raise
            raise UserError(
                f"network.module={self.module!r} cannot be made for {inputs} numbers and {outputs} outputs: "
                f"{type(error).__name__}: {error}"
            ) from error
        if tuple(shape) != (2, outputs):
            raise UserError(
                f"network.module={self.module!r} makes {list(shape)} of [2, {inputs}], and it must be [2, {outputs}]"
            )
        return made

"""Networks side by side, one a replica: what they share, and any module."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from copy import deepcopy

import torch
from torch import Tensor, nn
from torch.func import functional_call, stack_module_state, vmap


class ReplicaNetwork(nn.Module):
    """R networks side by side, one a replica: [R, B, in] → [R, B, out]; all parameters begin with R."""

    @abstractmethod
    def alone(self, replica: int, inputs: Tensor) -> Tensor:
        """The outputs [N, out] of one replica for inputs [N, in]."""

    @torch.no_grad()
    def best(self, inputs: Tensor) -> Tensor:
        """The output with the largest value [R, N] for the same many inputs [N, in] in every replica.

        One replica at a time: what lies between two layers then stays in the cache.
        """
        replicas = len(next(self.parameters()))
        return torch.stack([self.alone(replica, inputs).argmax(-1) for replica in range(replicas)])


class Replicated(ReplicaNetwork):
    """R modules of one kind: by `torch.func` where it carries the module, else one after the other.

    They are in evaluation mode, so that no network draws random numbers (dropout) or looks at a batch (batch norms).

    Args:
        modules: one a replica, [B, inputs] → [B, outputs]. inputs: numbers that go in.

    Attributes:
        loops: whether they run one after the other.
    """

    def __init__(self, modules: Sequence[nn.Module], inputs: int) -> None:
        super().__init__()
        for module in modules:
            module.eval()
        parameters, buffers = stack_module_state(list(modules))
        self._names = list(parameters)
        self._weights = nn.ParameterList(parameters.values())
        self._buffers_of = buffers
        self._frame = [deepcopy(modules[0])]  # in a list: its weights are none of ours
        device = self._weights[0].device
        self.loops = False
        try:
            self(torch.zeros(len(modules), 2, inputs, device=device))
        except (RuntimeError, ValueError, NotImplementedError):  # whatever vmap cannot carry
            self.loops = True

    def forward(self, values: Tensor) -> Tensor:
        """What each makes of its own [R, B, inputs]."""
        if self.loops:
            return torch.stack([self.alone(replica, own) for replica, own in enumerate(values)])
        found: Tensor = vmap(self._call)(self._state(), self._buffers_of, values)
        return found

    def alone(self, replica: int, inputs: Tensor) -> Tensor:
        """What one makes of [N, inputs]."""
        state, buffers = (
            {name: held[replica] for name, held in part.items()} for part in (self._state(), self._buffers_of)
        )
        return self._call(state, buffers, inputs)

    def _state(self) -> dict[str, Tensor]:
        return dict(zip(self._names, self._weights, strict=True))

    def _call(self, state: dict[str, Tensor], buffers: dict[str, Tensor], values: Tensor) -> Tensor:
        found: Tensor = functional_call(self._frame[0], (state, buffers), (values,))
        return found

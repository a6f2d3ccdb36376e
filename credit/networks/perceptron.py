"""Small networks with a leading replica dimension on every weight: R of them cost little more than one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torchrl.modules import MLP

from credit.core.problem import Problem
from credit.core.streams import generators
from credit.networks.replicated import ReplicaNetwork

PRECISION = torch.float32


class ReplicaLinear(nn.Module):
    """R linear layers side by side, [R, B, in] → [R, B, out].

    Args:
        inputs: numbers that go in. outputs: numbers that come out. bias: there always is one.
        streams: one generator a replica; weights and biases start uniform on ±1/√in, as in `torch.nn.Linear`.
    """

    def __init__(self, inputs: int, outputs: int, bias: bool, streams: Sequence[np.random.Generator]) -> None:
        super().__init__()
        bound = inputs**-0.5
        drawn = [
            np.stack([g.uniform(-bound, bound, shape) for g in streams]) for shape in ((inputs, outputs), (1, outputs))
        ]
        self.weight, self.bias = (nn.Parameter(torch.from_numpy(values).to(PRECISION)) for values in drawn)

    def forward(self, values: Tensor) -> Tensor:
        """x W + b for every replica."""
        return torch.baddbmm(self.bias, values, self.weight)


class ReplicaMLP(MLP, ReplicaNetwork):
    """R multi-layer perceptrons (ReLU, float32), one a replica: [R, B, in] → [R, B, out].

    Args:
        problem: gives the seeds, which decide the initial weights, and the device.
        inputs: numbers that go in. outputs: numbers that come out. hidden: widths between them.
        purpose: names the stream of the initial weights.
    """

    def __init__(self, problem: Problem, inputs: int, outputs: int, hidden: Sequence[int], purpose: str) -> None:
        # MLP copies what it is given for each layer, so that layers must not share a stream
        streams = [generators(problem.seeds, f"{purpose}, layer {layer}") for layer in range(len(hidden) + 1)]
        super().__init__(
            inputs,
            outputs,
            num_cells=list(hidden),
            activation_class=nn.ReLU,
            layer_class=ReplicaLinear,
            layer_kwargs=[{"streams": of_layer} for of_layer in streams],
            device=problem.device,
        )

    def alone(self, replica: int, inputs: Tensor) -> Tensor:
        """The outputs [N, out] of one replica for inputs [N, in]."""
        values = inputs
        for layer in self:
            if isinstance(layer, ReplicaLinear):
                values = torch.addmm(layer.bias[replica], values, layer.weight[replica])
            else:
                values = layer(values)
        return values


class ReplicaDueling(ReplicaNetwork):
    """R dueling networks: Q(s, a) = V(s) + A(s, a) − mean A(s, ·) (Wang et al. 2016, equation 9).

    V and A are streams that have the last hidden layer for themselves and share those before it.

    Args:
        problem: gives the seeds, which decide the initial weights, and the device.
        inputs: numbers that go in. outputs: how many actions there are. hidden: widths between them.
        purpose: names the stream of the initial weights.
    """

    def __init__(self, problem: Problem, inputs: int, outputs: int, hidden: Sequence[int], purpose: str) -> None:
        super().__init__()
        shared, own = list(hidden[:-1]), list(hidden[-1:])
        self._shares = bool(shared)
        if shared:
            self.trunk = ReplicaMLP(problem, inputs, shared[-1], shared[:-1], f"{purpose}, trunk")
        width = shared[-1] if shared else inputs
        self.value = ReplicaMLP(problem, width, 1, own, f"{purpose}, value")
        self.advantage = ReplicaMLP(problem, width, outputs, own, f"{purpose}, advantage")

    def forward(self, values: Tensor) -> Tensor:
        """Q [R, B, A] of inputs [R, B, in]."""
        seen = self.trunk(values).relu() if self._shares else values
        return dueling(self.value(seen), self.advantage(seen))

    def alone(self, replica: int, inputs: Tensor) -> Tensor:
        """Q [N, A] of one replica for inputs [N, in]."""
        seen = self.trunk.alone(replica, inputs).relu() if self._shares else inputs
        return dueling(self.value.alone(replica, seen), self.advantage.alone(replica, seen))


def dueling(value: Tensor, advantage: Tensor) -> Tensor:
    """V + A − mean A, of V [..., 1] and A [..., A].

    Example:
        >>> dueling(torch.tensor([1.0]), torch.tensor([0.0, 2.0]))
        tensor([0., 2.])
    """
    return value + advantage - advantage.mean(-1, keepdim=True)

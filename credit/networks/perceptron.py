"""Small networks with a leading replica dimension on every weight: R of them cost little more than one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torchrl.modules import MLP

from credit.core.problem import Problem
from credit.core.streams import generators

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


class ReplicaMLP(MLP):
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

    @torch.no_grad()
    def best(self, inputs: Tensor) -> Tensor:
        """The output with the largest value [R, N] for the same many inputs [N, in] in every replica.

        One replica at a time: what lies between two layers then stays in the cache.
        """
        found = []
        for replica in range(len(next(self.parameters()))):
            values = inputs
            for layer in self:
                if isinstance(layer, ReplicaLinear):
                    values = torch.addmm(layer.bias[replica], values, layer.weight[replica])
                else:
                    values = layer(values)
            found.append(values.argmax(-1))
        return torch.stack(found)

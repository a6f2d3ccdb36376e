"""Perceptrons side by side: N of one shape, one batched product a layer, one flat tensor of weights.

The flat tensor makes an optimizer's step or an average one operation, whatever the depth. The backward pass is written
out, because it then works in buffers that are kept: autograd allocates each of them again at every update, which at
256×256 costs as much as a third of the products themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from credit.core.state import Stateful

LANE = 16  # every block starts on a multiple: aligned for vectors and GPUs, and so it stands in checkpoints
EPSILON = 1e-5  # of the layer norm

_mask = torch.ops.aten.threshold_backward.grad_input


class Layer(NamedTuple):
    """Views of one layer's weights [N, out, in], bias [N, 1, out] and, where normalised, gain and shift [N, 1, out]."""

    weight: Tensor
    bias: Tensor
    gain: Tensor | None
    shift: Tensor | None


@dataclass(frozen=True)
class Shape:
    """inputs → depth × (linear of `width`, layer norm where `norm`, ReLU) → outputs: TorchRL's `MLP`."""

    inputs: int
    outputs: int
    width: int
    depth: int
    norm: bool = False

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """(in, out) of every layer."""
        ends = [self.inputs, *[self.width] * self.depth, self.outputs]
        return list(pairwise(ends))

    def blocks(self, members: int) -> list[tuple[int, ...]]:
        """Shapes of all weights, in the order in which they stand in the flat tensor."""
        shapes: list[tuple[int, ...]] = []
        for layer, (i, o) in enumerate(self.sizes):
            shapes += [(members, o, i), (members, 1, o)]
            if self.norm and layer < self.depth:
                shapes += [(members, 1, o)] * 2
        return shapes

    def numel(self, members: int) -> int:
        """Length of the flat tensor of N members."""
        return sum(padded(math.prod(block)) for block in self.blocks(members))


class Tape:
    """What a forward pass leaves for the backward pass, which overwrites it; kept from one update to the next.

    Attributes:
        input: [N, rows, in], for the caller to fill. output: [N, rows, out].
    """

    def __init__(self, shape: Shape, members: int, rows: int, device: torch.device) -> None:
        def empty(width: int) -> Tensor:
            return torch.empty(members, rows, width, device=device)

        self.input, self.output = empty(shape.inputs), empty(shape.outputs)
        self.hidden = [empty(shape.width) for _ in range(shape.depth)]
        self.delta = empty(shape.width)
        self.linear = [empty(shape.width) for _ in range(shape.depth)] if shape.norm else self.hidden
        self.normal: list[tuple[Tensor, Tensor, Tensor]] = []  # of every layer: normalised, mean, 1/deviation


class Stack(Stateful):
    """Views of N networks in a flat tensor [shape.numel(N)].

    Args:
        shape: what all of them look like. members: N. flat: their weights (or gradients, or averages).
        blocks: tensors that stand in for the views of the flat one.
    """

    keeps: ClassVar = ("blocks",)  # not the flat tensor: members are the leading dimension of blocks

    def __init__(self, shape: Shape, members: int, flat: Tensor, blocks: Sequence[Tensor] = ()) -> None:
        self.shape, self.members, self.flat = shape, members, flat
        self.blocks = list(blocks) or list(_views(flat, shape.blocks(members)))
        self.layers: list[Layer] = []
        rest = iter(self.blocks)
        for layer in range(shape.depth + 1):
            normal = shape.norm and layer < shape.depth
            self.layers.append(Layer(next(rest), next(rest), *((next(rest), next(rest)) if normal else (None, None))))
        self._transposed = [layer.weight.mT for layer in self.layers]

    @classmethod
    def drawn(cls, shape: Shape, generators: Sequence[np.random.Generator], device: torch.device) -> Stack:
        """Networks with first weights, one generator a member."""
        made = cls(shape, len(generators), torch.zeros(shape.numel(len(generators)), device=device))
        made.draw(generators)
        return made

    def another(self, generators: Sequence[np.random.Generator]) -> Stack:
        """As many of the same shape, with first weights of their own."""
        return Stack.drawn(self.shape, generators, self.flat.device)

    def passes(self, rows: int) -> Passes:
        """What trains them, on so many rows of each at a time."""
        return Passes(self, rows)

    def apart(self) -> Stack:
        """Empty memory of its own for every block: all of a flat tensor is copied where compiled code writes a part."""
        return Stack(self.shape, self.members, self.flat, [torch.empty_like(block) for block in self.blocks])

    def draw(self, generators: Sequence[np.random.Generator]) -> None:
        """Initial weights as PyTorch's linear layers have them, U(±1/√in), one generator a member; unit layer norm."""
        for layer, (inputs, _) in zip(self.layers, self.shape.sizes, strict=True):
            bound = 1 / math.sqrt(inputs)
            for part in layer[:2]:
                drawn = np.stack([g.uniform(-bound, bound, part.shape[1:]) for g in generators])
                part.copy_(torch.from_numpy(drawn))
            if layer.gain is not None and layer.shift is not None:
                layer.gain.fill_(1)
                layer.shift.zero_()

    def state(self, member: int) -> dict[str, Tensor]:
        """The weights of one member as the state of a TorchRL `MLP`: copies."""
        stride, state = 3 if self.shape.norm else 2, {}
        for k, layer in enumerate(self.layers):
            state[f"{k * stride}.weight"] = layer.weight[member].clone()
            state[f"{k * stride}.bias"] = layer.bias[member, 0].clone()
            if layer.gain is not None and layer.shift is not None:
                state[f"{k * stride + 1}.weight"] = layer.gain[member, 0].clone()
                state[f"{k * stride + 1}.bias"] = layer.shift[member, 0].clone()
        return state

    def forward(self, tape: Tape, masks: Sequence[Tensor] = ()) -> Tensor:
        """The outputs [N, rows, out] for `tape.input`.

        Args:
            masks: zeros and ones [N, rows, width] of every hidden layer, where units are dropped (and others not scaled
                up for it: the way back needs to know nothing of them).
        """
        x = tape.input
        tape.normal.clear()
        for k, layer in enumerate(self.layers[:-1]):
            x = torch.bmm(x, self._transposed[k], out=tape.linear[k])
            x.add_(layer.bias)
            if layer.gain is not None and layer.shift is not None:
                normal = torch.native_layer_norm(x, [self.shape.width], None, None, EPSILON)
                tape.normal.append(normal)
                x = torch.addcmul(layer.shift, normal[0], layer.gain, out=tape.hidden[k])
            x.relu_()
            if masks:
                x.mul_(masks[k])
        last = self.layers[-1]
        if self.shape.outputs == 1:  # one row times a matrix takes a third of the time of a matrix times one column
            return torch.baddbmm(last.bias, last.weight, x.mT, out=tape.output.mT).mT
        return torch.baddbmm(last.bias, x, self._transposed[-1], out=tape.output)

    def backward(self, tape: Tape, delta: Tensor, gradients: Stack | None) -> Tensor:
        """Gradients of the weights.

        Args:
            tape: of the forward pass; it is used up. delta: gradient by the outputs [N, rows, out].
            gradients: where those by the weights go; None if only the way to the inputs is wanted.

        Returns:
            Gradient by the first layer's output, before its norm and ReLU [N, rows, width].
        """
        for place in reversed(range(len(self.layers))):
            layer, x = self.layers[place], tape.hidden[place - 1] if place else tape.input
            if gradients is not None:
                into = gradients.layers[place]
                torch.bmm(delta.mT, x, out=into.weight)
                torch.sum(delta, 1, keepdim=True, out=into.bias)
            if not place:
                break
            if layer.weight.shape[1] == 1:
                torch.mul(delta, layer.weight, out=tape.delta)
            else:
                torch.bmm(delta, layer.weight, out=tape.delta)
            delta = _mask(tape.delta, x, 0, grad_input=x)
            if self.shape.norm:
                delta = self._through_norm(tape, place - 1, delta, gradients)
        return delta

    def member(self, m: int) -> list[Layer]:
        """The layers of one network without norms: weight [out, in], bias [out]."""
        return [Layer(layer.weight[m], layer.bias[m, 0], None, None) for layer in self.layers]

    def alone(self, m: int, rows: Tensor) -> Tensor:
        """The outputs [n] of one network without norms for rows [n, in]."""
        layers = self.member(m)
        return output(hidden(rows, layers[:-1]), layers[-1])

    def _through_norm(self, tape: Tape, place: int, delta: Tensor, gradients: Stack | None) -> Tensor:
        normal, mean, deviation = tape.normal[place]
        gain = self.layers[place].gain
        assert gain is not None
        if gradients is not None:
            into = gradients.layers[place]
            torch.sum(torch.mul(delta, normal, out=normal), 1, keepdim=True, out=into.gain)
            torch.sum(delta, 1, keepdim=True, out=into.shift)
        scaled, linear, wanted = delta.mul_(gain), tape.linear[place], [True, False, False]
        backward = torch.ops.aten.native_layer_norm_backward
        return backward(scaled, linear, [self.shape.width], mean, deviation, None, None, wanted)[0]


class Passes:
    """Forward and backward passes of networks in buffers of their own.

    Attributes:
        input: [N, rows, in], for the caller to fill. gradient: by all weights, flat.
    """

    def __init__(self, networks: Stack, rows: int) -> None:
        self._networks = networks
        self._tape = Tape(networks.shape, networks.members, rows, networks.flat.device)
        self._gradients = Stack(networks.shape, networks.members, torch.zeros_like(networks.flat))
        self.input, self.gradient = self._tape.input, self._gradients.flat

    def forward(self, masks: Sequence[Tensor] = ()) -> Tensor:
        """The outputs [N, rows, out]; see `Stack.forward`."""
        return self._networks.forward(self._tape, masks)

    def backward(self, delta: Tensor) -> None:
        """Write the gradient, where that by the outputs is delta [N, rows, out]."""
        self._networks.backward(self._tape, delta, self._gradients)


def hidden(rows: Tensor, layers: Sequence[Layer]) -> Tensor:
    """The last of some hidden layers [n, width] over rows [n, in]."""
    for layer in layers:
        rows = torch.addmm(layer.bias, rows, layer.weight.T).relu_()
    return rows


def output(units: Tensor, layer: Layer) -> Tensor:
    """The output [n] of the last layer over its units [n, width]."""
    return torch.addmv(layer.bias, units, layer.weight[0])


def _views(flat: Tensor, blocks: Sequence[tuple[int, ...]]) -> Iterator[Tensor]:
    start = 0
    for block in blocks:
        size = math.prod(block)
        yield flat[start : start + size].view(block)
        start += padded(size)


def padded(size: int) -> int:
    """The next multiple of a lane."""
    return -(-size // LANE) * LANE

"""A small convolution for observations that are images, such as MiniGrid's."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import torch
from torch import Tensor, nn
from torchrl.modules import MLP, ConvNet

from credit.core.errors import UserError
from credit.core.ranges import NonNegativeInt, Positive, PositiveInt
from credit.networks.modules import ACTIVATIONS, Activation, Network


class Convolution(Network):
    """Convolutions over an image, then a perceptron, on TorchRL's `ConvNet` and `MLP`.

    Observations come as vectors, and the image is a part of them. The other numbers, like a direction, the clock of DQN
    or the action that a critic is asked about, go to the perceptron beside what the convolutions make of the image.

    Args:
        shape: of the image: height, width and channels, as Gymnasium's images have them.
        first: which number of the vector the image begins with.
        divide: what its numbers are divided by, like 255 for bytes.
        channels: of the convolutions, one after the other. kernel: their height and width. stride: of each.
        hidden: widths of the perceptron's layers. activation: between all layers.

    Raises:
        UserError: when networks are made: the image is larger than the vector, or smaller than the kernels.
    """

    def __init__(
        self,
        shape: Sequence[PositiveInt],
        first: NonNegativeInt = 0,
        divide: Positive = 1.0,
        channels: Sequence[PositiveInt] = (16, 32),
        kernel: PositiveInt = 3,
        stride: PositiveInt = 1,
        hidden: Sequence[PositiveInt] = (64,),
        activation: Activation = "relu",
    ) -> None:
        if len(shape) != 3:
            raise UserError(f"network.shape={list(shape)}: an image has three: [height, width, channels]")
        self.shape, self.first, self.divide = tuple(shape), first, divide
        self.channels, self.kernel, self.stride = tuple(channels), kernel, stride
        self.hidden, self.activation = tuple(hidden), activation

    def make(self, inputs: int, outputs: int, device: torch.device) -> nn.Module:
        """With PyTorch's initial weights."""
        if self.first + prod(self.shape) > inputs:
            raise UserError(
                f"network.shape={list(self.shape)}: an image of {prod(self.shape)} numbers from number "
                f"{self.first} on, and networks see {inputs}; give the shape of the environment's image, height first"
            )
        kind = ACTIVATIONS[self.activation]
        seen = prod(self._sizes()) * self.channels[-1] if self.channels else prod(self.shape)
        beside = inputs - prod(self.shape)
        convolutions: nn.Module = nn.Flatten(-3)
        if self.channels:
            convolutions = ConvNet(
                in_features=self.shape[2],
                num_cells=list(self.channels),
                kernel_sizes=self.kernel,
                strides=self.stride,
                activation_class=kind,
            )
        head = MLP(seen + beside, outputs, num_cells=list(self.hidden), activation_class=kind)
        return Image(self.shape, self.first, self.divide, convolutions, head).to(device)

    def _sizes(self) -> tuple[int, int]:
        """Height and width behind the convolutions."""
        height, width = self.shape[:2]
        for layer in range(len(self.channels)):
            if min(height, width) < self.kernel:
                raise UserError(
                    f"network.kernel={self.kernel}: convolution {layer + 1} of {len(self.channels)} sees an "
                    f"image of {height}×{width}, which is smaller; take a smaller kernel or stride, or fewer channels"
                )
            height, width = ((size - self.kernel) // self.stride + 1 for size in (height, width))
        return height, width


class Image(nn.Module):
    """What sees a part of a vector as an image.

    Args:
        shape: of the image, height, width, channels. first: its first number. divide: what its numbers are divided by.
        convolutions: [..., channels, height, width] → [..., n]. head: what sees those n numbers and the rest.
    """

    def __init__(
        self, shape: Sequence[int], first: int, divide: float, convolutions: nn.Module, head: nn.Module
    ) -> None:
        super().__init__()
        self._shape, self._part, self._divide = tuple(shape), (first, prod(shape)), divide
        self.convolutions, self.head = convolutions, head

    def forward(self, values: Tensor) -> Tensor:
        """What it makes of vectors [..., inputs]."""
        first, size = self._part
        image = values.narrow(-1, first, size).reshape(-1, *self._shape).movedim(-1, -3) / self._divide
        seen = self.convolutions(image).reshape(*values.shape[:-1], -1)
        rest = [values[..., :first], values[..., first + size :]]
        found: Tensor = self.head(torch.cat([seen, *rest], -1))
        return found

"""PyTorch's global generator, which TorchRL's losses draw from, as a stream of a seed and a purpose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def seeded(seed: int, device: torch.device) -> Iterator[None]:
    """PyTorch's generators of the CPU and of a device start from a seed; afterwards they are what they were.

    Args:
        seed: at most 64 bits. device: where numbers are drawn.
    """
    cuda = device.type == "cuda"
    with torch.random.fork_rng([device] if cuda else []):
        torch.default_generator.manual_seed(seed)
        if cuda:
            with torch.cuda.device(device):
                torch.cuda.manual_seed(seed)
        yield

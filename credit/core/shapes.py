"""Shapes of what an equation is given: what does not fit is refused, and never broadcast."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor


def agree(**tensors: tuple[Tensor, str]) -> None:
    """Refuse tensors whose last dimensions do not fit each other, or whose leading ones differ.

    Args:
        tensors: name → a tensor and the names of its last dimensions; `M-1` is one less than `M`.

    Raises:
        ValueError: with all shapes, and what they should be.

    Example:
        >>> agree(mse=(mse, "M N"), disagreement=(gaps, "M-1 N"), best=(best, "N"))
    """
    if not _fit(tuple((tensor.shape, dims) for tensor, dims in tensors.values())):
        raise _misfit(tensors)


@lru_cache(maxsize=4096)  # equations see the same shapes in every round
def _fit(given: tuple[tuple[torch.Size, str], ...]) -> bool:
    sizes: dict[str, int] = {}
    leading = None
    for shape, dims in given:
        names = dims.split()
        if len(shape) < len(names):
            return False
        before = shape[: len(shape) - len(names)]
        if before != (leading := before if leading is None else leading):
            return False
        for name, size in zip(names, shape[len(before) :], strict=True):
            dimension, _, less = name.partition("-")
            whole = size + int(less or 0)
            if sizes.setdefault(dimension, whole) != whole:
                return False
    return True


def _misfit(tensors: dict[str, tuple[Tensor, str]]) -> ValueError:
    given = ", ".join(f"{name} {list(tensor.shape)}" for name, (tensor, _) in tensors.items())
    wanted = ", ".join(f"{name} [..., {', '.join(dims.split())}]" for name, (_, dims) in tensors.items())
    return ValueError(f"shapes do not fit: {given}; they must be {wanted}, with the same leading dimensions")

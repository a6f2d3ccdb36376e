"""Shapes of what an equation is given: what does not fit is refused, and never broadcast."""

from __future__ import annotations

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
    sizes: dict[str, int] = {}
    leading = None
    for tensor, dims in tensors.values():
        names, shape = dims.split(), tensor.shape
        if len(shape) < len(names):
            raise _misfit(tensors)
        before = shape[: len(shape) - len(names)]
        if before != (leading := before if leading is None else leading):
            raise _misfit(tensors)
        for name, size in zip(names, shape[len(before) :], strict=True):
            dimension, _, less = name.partition("-")
            whole = size + int(less or 0)
            if sizes.setdefault(dimension, whole) != whole:
                raise _misfit(tensors)


def _misfit(tensors: dict[str, tuple[Tensor, str]]) -> ValueError:
    given = ", ".join(f"{name} {list(tensor.shape)}" for name, (tensor, _) in tensors.items())
    wanted = ", ".join(f"{name} [..., {', '.join(dims.split())}]" for name, (_, dims) in tensors.items())
    return ValueError(f"shapes do not fit: {given}; they must be {wanted}, with the same leading dimensions")

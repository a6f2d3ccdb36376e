"""What a check says where a promise is broken: a sentence, with or without pytest, also under `python -O`."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


def expect(right: object, what: str) -> None:
    """Nothing, where it is right.

    Raises:
        AssertionError: it is not; with what was promised.
    """
    if not right:
        raise AssertionError(what)


def close(found: Tensor, wanted: Tensor, what: str, by: float | None = None) -> None:
    """Nothing, where two tensors are equal to rounding, or differ by less than `by`.

    Raises:
        AssertionError: they are not; with what was promised, and how far they are apart.
    """
    relative = None if by is None else 0.0
    torch.testing.assert_close(found, wanted, rtol=relative, atol=by, msg=lambda said: f"{what}: {said}")


def finite(value: Tensor, what: str) -> None:
    """Nothing, where every number is finite.

    Raises:
        AssertionError: one is not.
    """
    expect(torch.isfinite(value).all(), f"{what} must be finite, and {_count(~torch.isfinite(value))} are not")


def shaped(value: Any, shape: tuple[int, ...] | torch.Size, what: str) -> None:
    """Nothing, where a tensor has this shape.

    Raises:
        AssertionError: it has another, or is none.
    """
    given = list(value.shape) if isinstance(value, Tensor) else f"no tensor ({type(value).__name__})"
    expect(given == list(shape), f"{what}: {given}, and it must be {list(shape)}")


def _count(wrong: Tensor) -> str:
    return f"{int(wrong.sum())} of {wrong.numel()}"

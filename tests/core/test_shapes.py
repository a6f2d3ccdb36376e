"""Shapes that fit, and what is said of those that do not."""

from __future__ import annotations

import re

import pytest
import torch

from credit.core.shapes import agree


def zeros(*shape: int) -> torch.Tensor:
    return torch.zeros(shape)


@pytest.mark.parametrize("leading", [(), (2,), (4, 2)])
def test_shapes_that_fit_pass(leading: tuple[int, ...]) -> None:
    agree(
        mse=(zeros(*leading, 3, 5), "M N"),
        gaps=(zeros(*leading, 2, 5), "M-1 N"),
        best=(zeros(*leading, 5), "N"),
        square=(zeros(*leading, 3, 3), "M M"),
    )


@pytest.mark.parametrize(
    ("shapes", "said"),
    [
        (((2, 3, 5), (2, 4)), "mse [2, 3, 5], best [2, 4]; they must be mse [..., M, N], best [..., N]"),
        (((2, 3, 5), (5,)), "mse [2, 3, 5], best [5]; they"),  # never broadcast
        (((2, 3, 5), (1, 5)), "mse [2, 3, 5], best [1, 5]; they"),
        (((3, 5), (2, 5)), "mse [3, 5], best [2, 5]; they"),
        (((5,), (5,)), "mse [5], best [5]; they"),
        (((3, 5), ()), "mse [3, 5], best []; they"),
    ],
)
def test_shapes_that_do_not_fit_are_told(shapes: tuple[tuple[int, ...], ...], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        agree(mse=(zeros(*shapes[0]), "M N"), best=(zeros(*shapes[1]), "N"))


def test_one_less_is_one_less() -> None:
    with pytest.raises(ValueError, match=re.escape("gaps [..., M-1, N]")):
        agree(mse=(zeros(3, 5), "M N"), gaps=(zeros(3, 5), "M-1 N"))
    with pytest.raises(ValueError, match=re.escape("square [3, 2]; they must be square [..., M, M]")):
        agree(square=(zeros(3, 2), "M M"))

"""What was recorded in an environment's own spaces: is it of them, and what would an agent have done for it?"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Space, Tuple
from torch import Tensor

from credit.core.errors import UserError
from credit.envs.digits import Digits

BOUND = 1e-5  # of a bound, by which what was recorded in single precision may go over it


def actions_of(space: Space[Any], values: Any) -> Tensor:
    """What an agent does for actions [n, *shape]: numbers [n] int64, or vectors [n, A] float32 in [−1, 1].

    The other way round than the encoders of `credit.envs.spaces.actions`.

    Args:
        space: finite, or a box with bounds.

    Raises:
        UserError: they do not lie in that space.

    Example:
        >>> actions_of(Box(-2, 2, (1,)), [[1.0]])
        tensor([[0.5000]])
    """
    found = require("action", space, values)
    if (digits := Digits.of(space)) is not None:
        return digits.number(found)
    assert isinstance(space, Box), f"{space} has no encoder"
    low, span = space.low.astype(np.float64), space.high.astype(np.float64) - space.low
    share = np.where(span > 0, (found - low) / np.where(span > 0, span, 1.0), 0.5)
    return torch.from_numpy((2 * share - 1).clip(-1, 1).reshape(len(found), -1).astype(np.float32))


def require(name: str, space: Space[Any], values: Any) -> Any:
    """Values [n, *shape] of a space, as arrays of that shape.

    Args:
        name: what messages call them. space: any but those with values of different sizes. values: of n steps; a `Dict`
            is a mapping of such arrays, a `Tuple` a tuple of them.

    Raises:
        UserError: they have another shape, or one does not lie in the space; with its part and row.
    """
    nested = isinstance(space, (Dict, Tuple))
    if nested or isinstance(values, (Mapping, tuple)):
        inner = dict(space.spaces if isinstance(space, Dict) else enumerate(getattr(space, "spaces", ())))
        there = list(values if isinstance(values, Mapping) else range(len(values) if isinstance(values, tuple) else 0))
        if not nested or isinstance(values, Mapping) != isinstance(space, Dict) or not set(inner) <= set(there):
            raise UserError(f"{name} has the parts {there}, and here it must be of {space}")
        parts = {key: require(f"{name}[{key!r}]", part, values[key]) for key, part in inner.items()}
        return parts if isinstance(space, Dict) else tuple(parts.values())
    found, shape = np.asarray(values), space.shape or ()
    if found.dtype.kind not in "biuf" or found.size != len(found) * prod(shape):
        raise UserError(
            f"{name} has the shape {list(found.shape[1:])} of {found.dtype}, and here it must be of {space}"
        )
    found = found.reshape(len(found), *shape)
    if isinstance(space, Box):
        slack = BOUND * np.maximum(1, np.abs(np.where(np.isfinite(space.high), space.high, 1)))
        good = np.isfinite(found) & (found >= space.low - slack) & (found <= space.high + slack)
    else:
        digits = Digits.of(space)
        assert digits is not None
        flat = np.asarray(digits.flat(np.round(found)))
        good = (np.round(found) == found).reshape(flat.shape) & (flat >= 0) & (flat < digits.base.numpy())
    if not (right := good.reshape(len(found), -1).all(-1)).all():
        row = int((~right).argmax())
        raise UserError(f"{name} of row {row} is {found[row].tolist()}, and here it must be of {space}")
    return found if isinstance(space, Box) else found.astype(np.int64)

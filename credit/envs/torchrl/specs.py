"""The spaces of TorchRL's specs; values go to and fro by the specs' own `to_numpy` and `encode`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space
from torchrl.data import (
    Binary,
    Bounded,
    Categorical,
    Composite,
    MultiCategorical,
    MultiOneHot,
    OneHot,
    TensorSpec,
    Unbounded,
)

from credit.core.errors import UserError


def space(spec: TensorSpec) -> Space[Any]:
    """Where the values lie that `spec.to_numpy` gives and `spec.encode` takes.

    Raises:
        UserError: they are no numbers, or nobody knows how many values there are.

    Example:
        >>> space(OneHot(4))
        Discrete(4)
    """
    if isinstance(spec, Composite):
        return Dict({key: space(part) for key, part in spec.items()})
    if isinstance(spec, MultiOneHot) and spec.ndim == 1:
        return MultiDiscrete([part.n for part in spec.space])
    if isinstance(spec, MultiCategorical):
        return MultiDiscrete(spec.nvec.cpu().numpy())
    if isinstance(spec, Binary):
        return MultiBinary(spec.shape) if spec.shape else Discrete(2)
    if isinstance(spec, OneHot) and not isinstance(spec, MultiOneHot):
        return _numbers(spec, spec.shape[:-1])
    if isinstance(spec, Categorical):
        return _numbers(spec, spec.shape)
    if isinstance(spec, Bounded):
        low, high = (bound.cpu().numpy() for bound in (spec.space.low, spec.space.high))
        return Box(low, high, tuple(spec.shape), low.dtype.type)
    if isinstance(spec, Unbounded):
        kind = torch.empty(0, dtype=spec.dtype).numpy().dtype
        least, most = (-np.inf, np.inf) if spec.dtype.is_floating_point else _whole(kind)
        return Box(least, most, tuple(spec.shape), kind.type)
    raise _none(spec)


def _numbers(spec: TensorSpec, shape: torch.Size) -> Space[Any]:
    count = int(spec.space.n)
    if count < 1:
        raise _none(spec)
    return MultiDiscrete(np.full(tuple(shape), count)) if shape else Discrete(count)


def _whole(kind: np.dtype[Any]) -> tuple[int, int]:
    return (0, 1) if kind == np.bool_ else (int(np.iinfo(kind).min), int(np.iinfo(kind).max))


def _none(spec: TensorSpec) -> UserError:
    text = " ".join(str(spec).split())
    return UserError(
        f"a spec {text[:120]}: learners see and do numbers (Bounded, Unbounded, Categorical, OneHot, MultiCategorical, "
        "MultiOneHot, Binary, and Composite ones of these)"
    )

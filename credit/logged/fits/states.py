"""States of registered models as JSON and arrays: what `credit.core.state` packs, with a name for each tensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from credit.core.errors import UserError


def split(state: Any, arrays: dict[str, np.ndarray]) -> Any:
    """What JSON knows of a state; its tensors go to `arrays`.

    Raises:
        UserError: something in it is neither.
    """
    if isinstance(state, torch.Tensor):
        name = f"tensor.{len(arrays)}"
        try:
            arrays[name] = state.detach().cpu().numpy()
        except TypeError as error:  # a type that arrays do not have
            raise UserError(f"a tensor of its state cannot be saved: {error}") from None
        return {"tensor": name}
    if isinstance(state, float) and not math.isfinite(state):
        return {"float": str(state)}
    if state is None or type(state) in (bool, int, float, str):
        return state
    if isinstance(state, Mapping) and all(isinstance(key, str) for key in state):
        return {"dict": {key: split(value, arrays) for key, value in state.items()}}
    if isinstance(state, list | tuple):
        return [split(value, arrays) for value in state]
    raise UserError(f"its state holds a {type(state).__name__}, which is no plain value and no tensor")


def joined(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """The state that was split.

    Raises:
        KeyError, TypeError, ValueError: it is no such thing.
    """
    if isinstance(plain, list):
        return [joined(value, arrays) for value in plain]
    if not isinstance(plain, Mapping):
        return plain
    ((tag, content),) = plain.items()
    if tag == "tensor":
        return torch.from_numpy(np.array(arrays[content]))
    if tag == "float":
        return float(content)
    if tag == "dict":
        return {key: joined(value, arrays) for key, value in content.items()}
    raise ValueError(f"{tag!r} is no part of a state")

"""Encoders: from any Gymnasium space to what learners see, numbers (`Discrete`) or flat vectors (`Box`).

All work on whole batches, [R, K, ...] or any other leading dimensions, with the rules of `gymnasium.spaces.flatten`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import prod
from typing import Any, Literal

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space, Tuple, flatten_space
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.envs.digits import Digits

LARGEST = 100_000  # values that a space may have and still be a number
WIDEST = 10_000  # values that a part of an observation may have and still be seen one-hot: 40 kB of every step
View = Literal["auto", "number", "vector"]


class Observations(ABC):
    """How an observation becomes what a learner sees.

    Attributes:
        space: `Discrete` or `Box`, as the problem has it.
    """

    space: Space[Any]

    @abstractmethod
    def __call__(self, values: Any) -> Tensor:
        """Observations of the environment's space, as arrays or tensors with leading dimensions, → [..., ] or [..., O].

        A `Dict` is a mapping of such arrays, a `Tuple` a tuple of them.
        """


class Actions(ABC):
    """How what a learner does becomes an action.

    Attributes:
        space: `Discrete`, or a `Box` in [−1, 1], as the problem has it.
    """

    space: Space[Any]

    @abstractmethod
    def __call__(self, actions: Tensor) -> Tensor:
        """Numbers [...] or vectors [..., A] → actions [..., *shape] of the environment's space."""


class Numbers(Observations):
    """A finite observation as a number, 0 … S − 1.

    Raises:
        UserError: the space is not finite, or too large to count.
    """

    def __init__(self, space: Space[Any]) -> None:
        digits = Digits.of(space)
        if digits is None or digits.count > LARGEST:
            size = "is not finite" if digits is None else f"has {digits.count} values, at most {LARGEST} are counted"
            raise UserError(f"observation space {space} {size}; see it as a vector (as_='vector')")
        self._digits, self.space = digits, Discrete(digits.count)

    def __call__(self, values: Any) -> Tensor:
        """Numbers [...] int64."""
        return self._digits.number(values)


class Vectors(Observations):
    """Any observation as a vector, as `gymnasium.spaces.flatten` has it: numbers one-hot, boxes as they are.

    Raises:
        UserError: the space has values of different sizes (Text, Sequence, Graph), or too many to be seen one-hot.
    """

    def __init__(self, space: Space[Any]) -> None:
        self._space = space
        self.space = _bounded(space)

    def __call__(self, values: Any) -> Tensor:
        """Vectors [..., O] float32."""
        return _flat(self._space, values)


class Choices(Actions):
    """A number as an action of a finite space.

    Raises:
        UserError: too many to count.
    """

    def __init__(self, space: Space[Any]) -> None:
        digits = Digits.of(space)
        assert digits is not None, f"{space} is not finite"
        if digits.count > LARGEST:
            raise UserError(f"action space {space} has {digits.count} values, at most {LARGEST} are counted")
        self._digits, self._kind, self.space = digits, _kind(space), Discrete(digits.count)

    def __call__(self, actions: Tensor) -> Tensor:
        """Actions [..., *shape] of numbers [...], of the space's type."""
        return self._digits.values(actions).to(self._kind)


class Scaled(Actions):
    """A vector in [−1, 1] as an action between the bounds of a box.

    Raises:
        UserError: a bound is infinite.
    """

    def __init__(self, space: Box) -> None:
        if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
            raise UserError(
                f"action space {space} has no bounds, and agents act in [-1, 1]: there is nothing to scale to; wrap "
                "the environment so that it has (gymnasium.wrappers.RescaleAction, ClipAction or TransformAction)"
            )
        self._low, self._high = (torch.from_numpy(np.asarray(part, np.float64)) for part in (space.low, space.high))
        self._whole, self._kind = np.issubdtype(space.dtype, np.integer), _kind(space)
        self.space = Box(-1.0, 1.0, (prod(space.shape),))

    def __call__(self, actions: Tensor) -> Tensor:
        """Actions [..., *shape] of vectors [..., A]; the nearest whole ones where the space has only those."""
        low, high = self._low.to(actions.device), self._high.to(actions.device)
        share = (actions.clamp(-1, 1).to(low.dtype).reshape(*actions.shape[:-1], *low.shape) + 1) / 2
        value = torch.lerp(low.expand_as(share), high.expand_as(share), share)
        return (value.round() if self._whole else value).to(self._kind)


def observations(space: Space[Any], as_: View = "auto") -> Observations:
    """The encoder of an observation space: a number where it is finite and small, else a vector.

    Args:
        space: any of Gymnasium's but Text, Sequence, Graph. as_: `number` or `vector` to have it so.

    Raises:
        UserError: it cannot be seen so.

    Example:
        >>> observations(MultiDiscrete([3, 4])).space
        Discrete(12)
    """
    digits = Digits.of(space)
    small = digits is not None and digits.count <= LARGEST
    return Numbers(space) if as_ == "number" or (as_ == "auto" and small) else Vectors(space)


def actions(space: Space[Any]) -> Actions:
    """The encoder of an action space: a finite one is a number, a bounded box a vector in [−1, 1].

    Raises:
        UserError: a box without bounds, or a space that is neither.
    """
    if Digits.of(space) is not None:
        return Choices(space)
    if isinstance(space, Box):
        return Scaled(space)
    raise UserError(
        f"action space {space}: agents act in Discrete, MultiDiscrete, MultiBinary and bounded Box spaces; wrap the "
        "environment so that it has one of these (gymnasium.wrappers.TransformAction)"
    )


def problem(
    seen: Observations,
    done: Actions,
    window: int,
    seeds: tuple[int, ...],
    device: torch.device | str = "cpu",
    episodic: bool = True,
    horizon: int = 0,
) -> Problem:
    """The problem of an environment with these encoders."""
    return Problem(seen.space, done.space, window, tuple(seeds), torch.device(device), episodic, horizon)


def outside(space: Space[Any], values: Any) -> np.ndarray | None:
    """Which of n values [n, *shape] are none that a finite space has [n], by any part; None where no part is finite.

    Boxes are not held to their bounds, which many environments do not keep.

    Example:
        >>> outside(Discrete(5), np.array([4, 5, -1]))
        array([False,  True,  True])
    """
    if isinstance(space, (Dict, Tuple)):
        found = [part for inner in _parts(space, values) if (part := outside(*inner)) is not None]
        return np.logical_or.reduce(found) if found else None
    if not isinstance(space, (Discrete, MultiDiscrete, MultiBinary)):
        return None
    least: Any = 0 if isinstance(space, MultiBinary) else space.start
    count: Any = 2 if isinstance(space, MultiBinary) else space.n if isinstance(space, Discrete) else space.nvec
    wrong: np.ndarray = (values < least) | (values - least >= count)
    return np.asarray(wrong.reshape(len(wrong), -1).any(1))


def _kind(space: Space[Any]) -> torch.dtype:
    """The type of a space's numbers."""
    return torch.from_numpy(np.zeros(1, space.dtype)).dtype


def _parts(space: Space[Any], values: Any) -> list[tuple[Space[Any], Any]]:
    if isinstance(space, Dict):
        assert isinstance(values, Mapping)
        return [(inner, values[key]) for key, inner in space.spaces.items()]
    assert isinstance(space, Tuple)
    return list(zip(space.spaces, values, strict=True))


def _width(space: Space[Any]) -> int:
    if isinstance(space, (Dict, Tuple)):
        inner = space.spaces.values() if isinstance(space, Dict) else space.spaces
        return sum(map(_width, inner))
    if isinstance(space, (Discrete, MultiDiscrete)):
        digits = Digits.of(space)
        assert digits is not None
        if (width := int(digits.base.sum())) > WIDEST:
            number = "see it as a number (env.view=number), or " if digits.count <= LARGEST else ""
            raise UserError(
                f"observation space {space} would be seen one-hot, as {width} numbers in every step, and at most "
                f"{WIDEST} are; {number}wrap the environment so that it has a smaller one, such as coordinates in a "
                "Box (gymnasium.wrappers.TransformObservation)"
            )
        return width
    if isinstance(space, (Box, MultiBinary)):
        return prod(space.shape)
    raise UserError(
        f"observation space {space} has values of different sizes, and learners see vectors of one size; wrap the "
        "environment so that it has a Box, Dict or Tuple (gymnasium.wrappers.TransformObservation)"
    )


def _bounded(space: Space[Any]) -> Box:
    """The vectors of a space, with the bounds that it has."""
    _width(space)  # refuses what has none
    flat = flatten_space(space)
    assert isinstance(flat, Box)
    with np.errstate(over="ignore"):  # the largest float64 stands for infinity
        low, high = (np.asarray(part).reshape(-1).astype(np.float32) for part in (flat.low, flat.high))
    return Box(low, high)


def _flat(space: Space[Any], values: Any) -> Tensor:
    if isinstance(space, (Dict, Tuple)):
        return torch.cat([_flat(inner, part) for inner, part in _parts(space, values)], -1)
    if isinstance(space, (Discrete, MultiDiscrete)):
        digits = Digits.of(space)
        assert digits is not None
        columns = zip(digits.flat(values).unbind(-1), digits.base.tolist(), strict=True)
        return torch.cat([torch.nn.functional.one_hot(digit, base) for digit, base in columns], -1).float()
    numbers = torch.as_tensor(values)
    lead = numbers.dim() - len(space.shape or ())
    return numbers.reshape(*numbers.shape[:lead], -1).float()

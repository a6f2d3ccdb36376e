"""Loops over replicas that are compiled by Numba.

With ten states and twenty replicas a round is hundreds of tensor operations, each of which costs more to call than to
compute. A loop costs one call. It does what the tensor operations beside it do, to rounding, and they stay: for other
devices, and to compare with. `NUMBA_DISABLE_JIT=1` switches loops off.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray
from torch import Tensor

from credit.core.kept import kept


class Loop:
    """A function of arrays and numbers, compiled when it is first called with tensors; as an ordinary one, it is slow.

    Args:
        function: in the part of Python and NumPy that Numba knows. It may change its arrays.

    Example:
        >>> @Loop
        ... def double(values):
        ...     for i in range(len(values)):
        ...         values[i] *= 2
        >>> if usable(tensor): double(tensor)
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.__doc__ = function, function.__doc__
        self._compiled: Callable[..., Any] | None = None

    def __call__(self, *given: Tensor | NDArray[Any] | float) -> Any:
        """What the function makes of tensors on the processor, which it sees as arrays, of arrays and of numbers."""
        if self._compiled is None:
            self._compiled = kept(self.function)
        return self._compiled(*[value.numpy() if isinstance(value, Tensor) else value for value in given])


def usable(tensor: Tensor) -> bool:
    """Whether a loop may take the place of tensor operations on what lies where this does."""
    return tensor.device.type == "cpu" and os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"

"""Functions that Numba compiles, and keeps for other processes where there is a place for it. Light to import."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def kept(function: Callable[..., Any], **options: Any) -> Any:
    """A function compiled when it is first called.

    Args:
        function: of a module, and not within another function, or each process compiles it anew. options: of Numba's.
    """
    import numba  # half a second, for those that call a loop

    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep what was compiled
        return numba.njit(**options)(function)

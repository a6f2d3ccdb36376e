"""How many threads a run computes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from credit.core.errors import UserError


@contextmanager
def limited(count: int | None) -> Iterator[None]:
    """Compute on `count` threads, and then on as many as before; None leaves the process as it is.

    Raises:
        UserError: `count` is below 1.
    """
    if count is None:
        yield
        return
    if count < 1:
        raise UserError(f"threads={count}: at least 1 is needed, or None to leave the process as it is")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)

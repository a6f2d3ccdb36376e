"""Where modules of the user's own are looked for."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def findable(folder: Path) -> Iterator[None]:
    """Let the modules of a folder be imported, behind all that is installed: for `env.id=my_module:Mine-v0`.

    Args:
        folder: the working folder. Where Python was told not to look there (`-P`, `PYTHONSAFEPATH`), it is not.
    """
    place = str(folder)
    if sys.flags.safe_path or place in sys.path:
        yield
        return
    sys.path.append(place)
    try:
        yield
    finally:
        if place in sys.path:
            sys.path.remove(place)

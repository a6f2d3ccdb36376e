"""Where modules of the user's own are looked for."""

from __future__ import annotations

import sys
from pathlib import Path


def findable(folder: Path) -> None:
    """Let the modules of a folder be imported, behind all that is installed: for `env.id=my_module:Mine-v0`.

    Args:
        folder: the working folder. Where Python was told not to look there (`-P`, `PYTHONSAFEPATH`), it is not.
    """
    if not sys.flags.safe_path and (place := str(folder)) not in sys.path:
        sys.path.append(place)

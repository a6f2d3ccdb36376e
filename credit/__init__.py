"""credit: reinforcement learning when rewards come late.

Example:
    >>> import credit
    >>> result = credit.run(["experiment=advertiser", "method=disagreement", "replicas=5"])
    >>> result.metrics["regret/cumulative"].mean()
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from credit.loading import Run, load
    from credit.resuming import resume
    from credit.runner import Result, compose, run

os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # TorchRL reads it once, and tells of every buffer otherwise

__all__ = ["Result", "Run", "compose", "load", "resume", "run"]
_HOMES = {
    "compose": "runner",
    "load": "loading",
    "resume": "resuming",
    "Result": "runner",
    "Run": "loading",
    "run": "runner",
}


def __getattr__(name: str) -> Any:
    """Import on first use, so that `credit --help` and the uploader do not wait for torch."""
    if name not in _HOMES:
        raise AttributeError(f"module 'credit' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"credit.{_HOMES[name]}"), name)

"""What is registered, by name: for those who read run folders and say what could be run."""

from __future__ import annotations

from credit.config import files


def offered(kind: str) -> list[str]:
    """The names of what can be chosen of a kind, such as `method`; what only a `--config-dir` has is not among them."""
    return list(files.options(kind))

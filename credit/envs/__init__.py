"""Environments. `import credit` alone registers `credit/Advertiser-v0` and `credit/Sepsis-v0` with Gymnasium."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from credit.envs.delayed import DelayedReward

__all__ = ["DelayedReward"]


def __getattr__(name: str) -> Any:
    """`DelayedReward`, which needs torch and Gymnasium, when somebody asks for it."""
    if name == "DelayedReward":
        from credit.envs.delayed import DelayedReward

        return DelayedReward
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

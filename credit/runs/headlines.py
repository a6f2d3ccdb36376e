"""The metrics that a line about a run has room for, the main one first."""

from __future__ import annotations

from collections.abc import Collection

HEADLINES = {  # metric → whether less of it is better
    "regret/cumulative": True,
    "eval/final": False,
    "eval/auc": False,
    "eval/success": False,
    "eval/return": False,
    "return/policy": False,
    "return/label": False,
    "policy/error": True,
    "reward/mse": True,
}


def main_of(known: Collection[str]) -> str | None:
    """The main one of some metrics; None where it is not among them."""
    return next((name for name in HEADLINES if name in known), None)

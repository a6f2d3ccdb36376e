"""Tracking: what becomes of a session's local journal while it grows.

A trainer writes the journal and never waits for a tracking store: another process mirrors it there.
"""

from __future__ import annotations

from credit.tracking.mlflow import MLflowTracking
from credit.tracking.seam import NoTracking, Tracking
from credit.tracking.sessions import Seeds

__all__ = ["MLflowTracking", "NoTracking", "Seeds", "Tracking"]

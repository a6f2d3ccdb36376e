"""Runs in MLflow: a sweep, below it jobs, below them seeds; `credit dashboard` shows them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from credit.tracking.mirrored import Mirrored
from credit.tracking.sessions import Seeds
from credit.tracking.store import VARIABLE, dashboard, resolve_uri, uri_problem

if TYPE_CHECKING:
    from credit.tracking.ledger import Ledger


class MLflowTracking(Mirrored):
    """Mirrors the journal to MLflow.

    Args:
        uri: tracking URI; None is that of the environment (MLFLOW_TRACKING_URI), or `mlflow.db` in the output folder.
        seeds: as in `Mirrored`.
    """

    title, package = "MLflow", "mlflow"

    def __init__(self, uri: str | None = None, seeds: Seeds = "auto"):
        super().__init__(seeds)
        self.uri = uri if uri is not None else os.environ.get(VARIABLE) or None

    def check(self, output: Path) -> list[str]:
        """MLflow is missing, or a tracking URI is none."""
        problem = uri_problem(self.uri)
        return [*super().check(output), *([problem] if problem else [])]

    def address(self, output: Path) -> str:
        """The resolved tracking URI."""
        return resolve_uri(self.uri, output)

    def look(self, output: Path) -> str:
        """`credit dashboard`."""
        return dashboard(output, self.uri)


def open_ledger(file: Path, uri: str, output: Path, session: str) -> Ledger:
    """What MLflow holds of a session; arguments as `Ledger` has them."""
    from credit.tracking.mlflow_ledger import MLflowLedger

    return MLflowLedger(file, uri, output, session)

"""One MLflow run as the ledger remembers it, and as it shall be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from credit.tracking.curves import Row
from credit.tracking.describe import RunCard


@dataclass
class Entry:
    """One MLflow run: holds the rows up to `step`, was told `status`; `problem` is why it was given up.

    Points in time count from `started` (epoch milliseconds), whichever session adds them.
    """

    id: str
    started: int
    described: bool = False
    step: int = -1
    rows: int = 0
    status: str = "RUNNING"
    parent: str | None = None
    problem: str | None = None


@dataclass(frozen=True)
class Upload:
    """What MLflow shall hold of one run: card, rows beyond a step, status, end (epoch seconds), files, error.

    `picture` draws, in SVG, what came out, once the run has ended.
    `folder` is the run folder of a seed: whichever session fills it, it is one run.
    """

    key: str
    experiment: str
    card: RunCard
    rows: Callable[[int], Sequence[Row]] = lambda after: ()
    status: str = "RUNNING"
    finished: float | None = None
    files: Sequence[Path] = ()
    texts: tuple[tuple[str, str], ...] = ()
    picture: Callable[[], str | None] = lambda: None
    error: str | None = None
    folder: Path | None = None

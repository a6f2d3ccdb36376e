"""`mlflow.json` in a run's folder: which MLflow run it is, and which session fills it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from credit.tracking.journal import write_json

FILE = "mlflow.json"


@dataclass(frozen=True)
class Note:
    """A seed's run: the store, the session that owns it, its key there, its id (empty before it was made)."""

    uri: str
    session: str
    key: str
    run: str

    @classmethod
    def read(cls, folder: Path) -> Note | None:
        """The note of a run folder; None where there is none, or none that can be read."""
        try:
            return cls(**json.loads((folder / FILE).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            return None

    def write(self, folder: Path) -> None:
        """Write the note, whole or not at all."""
        write_json(folder / FILE, asdict(self))

"""The folder of a recovery: steps, windows, effects and what was asked; whole, or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from credit.core.errors import UserError

if TYPE_CHECKING:
    from credit.logged.result import LoggedCredit

DONE = "DONE"


@dataclass(frozen=True)
class Folder:
    """Where a recovery is written.

    Attributes:
        path: the folder.
    """

    path: Path

    @classmethod
    @contextmanager
    def made(cls, path: Path, words: Sequence[str]) -> Iterator[Folder]:
        """A folder that takes its place when all is written: beside it until then, and gone if that fails.

        Raises:
            UserError: the place is taken by something that is no recovery.
        """
        cls.require_free(path)
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir(parents=True)
        try:
            yield cls(beside)
            (beside / DONE).write_text(" ".join(words) + "\n", encoding="utf-8")
            if path.exists():
                shutil.rmtree(path)
            beside.rename(path)
        finally:
            shutil.rmtree(beside, ignore_errors=True)

    @staticmethod
    def require_free(path: Path) -> None:
        """Refuse to take the place of anything but an earlier recovery.

        Raises:
            UserError: the place is taken.
        """
        if path.exists() and (not path.is_dir() or (any(path.iterdir()) and not (path / DONE).exists())):
            raise UserError(f"{path}: this is there, and no recovery; choose another place by name=… or output=…")

    def write(self, found: LoggedCredit, format: str = "parquet") -> None:
        """All frames, and numbers in `summary.json`."""
        import pandas as pd

        self._steps(found, format)
        for name in ("windows", "effects", "told", "placebo", "labelled", "robustness"):
            getattr(found, name).to_csv(self.path / f"{name}.csv", index=False)
        policy = found.policies
        if policy is not None and len(policy.table):
            policy.table.to_csv(self.path / "policy.csv", index=False)
            pd.DataFrame([vars(value) for value in policy.values]).to_csv(self.path / "policy_values.csv", index=False)
        summary = {
            "said": list(found.said),
            "metrics": {key: None if value != value else value for key, value in found.metrics.items()},
            "chosen": found.chosen,
            "resampled": found.found.units.kind,
            "policy": "" if policy is None else policy.said,
        }
        (self.path / "summary.json").write_text(json.dumps(summary, indent=2, ensure_ascii=False), encoding="utf-8")

    def _steps(self, found: LoggedCredit, format: str) -> None:
        from credit.logged.scoring import frames

        if format == "csv":
            found.steps.rename_axis("row").to_csv(self.path / "steps.csv")
            return
        import pyarrow as pa
        import pyarrow.parquet as pq

        writer = None
        for frame in frames(found.found.panel, found.found.names, found.rows):
            table = pa.Table.from_pandas(frame.rename_axis("row").reset_index(), preserve_index=False)
            if writer is None:
                writer = pq.ParquetWriter(self.path / "steps.parquet", table.schema)
            writer.write_table(table)
        if writer is not None:
            writer.close()

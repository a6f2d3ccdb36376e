"""The folder of a recovery: steps, windows, effects and what was asked; whole, or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.core.errors import UserError

if TYPE_CHECKING:
    from credit.logged.panel import Panel
    from credit.logged.recovered import Recovered
    from credit.logged.result import LoggedCredit
    from credit.logged.scored import ScoredTable
    from credit.logged.scoring import Scored

DONE, STOPPED = "DONE", "STOPPED"
MODEL = "model"  # in the folder of a recovery


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

        Where Ctrl-C stops it behind the fit, that is kept: `model/`, which scores rows, and a file STOPPED; beside an
        earlier result, which stays.

        Raises:
            UserError: the place is taken by something that is no recovery, or nothing can be written there.
        """
        cls.require_free(path)
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        shutil.rmtree(beside, ignore_errors=True)
        new = [folder for folder in beside.parents if not folder.exists()]  # the inmost first
        try:
            beside.mkdir(parents=True)
        except OSError as error:
            raise UserError(
                f"{path}: nothing can be written there ({error.strerror}); choose another place by output=…"
            ) from None
        try:
            yield cls(beside)
            cls._placed(beside, path, DONE, words)
        except KeyboardInterrupt:
            if (beside / MODEL).exists():
                for other in beside.iterdir():
                    if other.name != MODEL:
                        other.unlink()
                cls._placed(beside, path, STOPPED, words)
            raise
        finally:
            shutil.rmtree(beside, ignore_errors=True)
            for folder in new:  # nothing is left where nothing was made
                with suppress(OSError):
                    folder.rmdir()

    @staticmethod
    def _placed(beside: Path, path: Path, mark: str, words: Sequence[str]) -> None:
        (beside / mark).write_text(" ".join(words) + "\n", encoding="utf-8")
        path = Folder.place(path, mark)
        if path.exists():
            shutil.rmtree(path)
        beside.rename(path)

    @staticmethod
    def place(path: Path, mark: str) -> Path:
        """Where a recovery goes that ended in this way: what was stopped never in the place of what is whole."""
        whole = mark == STOPPED and (path / DONE).exists()
        return path.with_name(f"{path.name}-stopped") if whole else path

    @staticmethod
    def require_free(path: Path, keep_models: bool = False) -> None:
        """Refuse to take the place of anything but an earlier recovery; `keep_models`: nor of one with a model.

        Raises:
            UserError: the place is taken.
        """
        if keep_models and (path / MODEL).exists():
            raise UserError(f"{path}: a model lies there; choose another place for scored rows by name=… or output=…")
        ours = any((path / mark).exists() for mark in (DONE, STOPPED))
        if path.exists() and (not path.is_dir() or (any(path.iterdir()) and not ours)):
            raise UserError(f"{path}: this is there, and no recovery; choose another place by name=… or output=…")

    def write_text(self, name: str, text: str) -> None:
        """A file of one's own."""
        (self.path / name).write_text(text, encoding="utf-8")

    def write_model(self, found: Recovered) -> None:
        """`model/`, once, where all models can be saved."""
        from credit.logged.saving import SavedModel

        if not found.fitted.unsaved and not (self.path / MODEL).exists():
            SavedModel.of(found).write(self.path / MODEL)

    def write(self, found: LoggedCredit, format: str = "parquet") -> None:
        """All frames, numbers in `summary.json`, and all of it to be read in `report.html`."""
        import pandas as pd

        self.write_model(found.found)
        self._steps(found.found.panel, found.found.names, found.rows, format)
        for name in ("windows", "effects", "told", "placebo", "labelled", "robustness"):
            getattr(found, name).to_csv(self.path / f"{name}.csv", index=False)
        policy = found.policies
        if policy is not None and len(policy.table):
            policy.table.to_csv(self.path / "policy.csv", index=False)
            pd.DataFrame([vars(value) for value in policy.values]).to_csv(self.path / "policy_values.csv", index=False)
        summary = {
            "said": list(found.said),
            "metrics": found.metrics,
            "chosen": found.chosen,
            "resampled": found.found.units.kind,
            "policy": "" if policy is None else policy.said,
        }
        self._summary(summary)
        found.to_html(self.path / "report.html")

    def write_scored(self, table: ScoredTable, model: Path, format: str = "parquet") -> None:
        """Steps, windows where there are some, and numbers in `summary.json`, of rows that a model had not seen."""
        self._steps(table.panel, table.fitted.names, table.rows, format)
        if table.windows is not None:
            table.windows.to_csv(self.path / "windows.csv", index=False)
        self._summary({"model": str(model), "said": list(table.said), "metrics": table.metrics})

    def _summary(self, summary: Mapping[str, Any]) -> None:
        metrics = {key: None if value != value else value for key, value in summary["metrics"].items()}
        text = json.dumps({**summary, "metrics": metrics}, indent=2, ensure_ascii=False)
        (self.path / "summary.json").write_text(text, encoding="utf-8")

    def _steps(self, panel: Panel, names: Sequence[str], rows: Scored, format: str) -> None:
        from credit.logged.scoring import frames, in_order

        if format == "csv":
            in_order(frames(panel, names, rows)).rename_axis("row").to_csv(self.path / "steps.csv")
            return
        import pyarrow as pa
        import pyarrow.parquet as pq

        writer = None
        for frame in frames(panel, names, rows):
            table = pa.Table.from_pandas(frame.rename_axis("row").reset_index(), preserve_index=False)
            if writer is None:
                writer = pq.ParquetWriter(self.path / "steps.parquet", table.schema)
            writer.write_table(table)
        if writer is not None:
            writer.close()

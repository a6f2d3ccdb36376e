"""MLflow runs by a key of ours, and what each of them already holds."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import Metric, Param
from mlflow.exceptions import MlflowException

from credit.tracking.curves import Row
from credit.tracking.describe import RunCard, safe_name
from credit.tracking.store import open_experiment

KEY_TAG = "credit.key"
MAX_METRICS, MAX_PARAMS, MAX_RUNS = 1000, 100, 1000
# Errors that belong to one run (say, someone deleted it in the UI): the others go on without it.
_OF_ONE_RUN = {"RESOURCE_DOES_NOT_EXIST", "INVALID_PARAMETER_VALUE", "INVALID_STATE", "BAD_REQUEST"}


@dataclass
class Entry:
    """One MLflow run: holds the rows up to `step`, was told `status`; `problem` is why it was given up."""

    id: str
    described: bool = False
    step: int = -1
    rows: int = 0
    status: str = "RUNNING"
    problem: str | None = None


@dataclass(frozen=True)
class Upload:
    """What MLflow shall hold of one run: card, rows so far, status, end (epoch seconds), files, notes."""

    key: str
    experiment: str
    card: RunCard
    rows: Sequence[Row] = ()
    status: str = "RUNNING"
    finished: float | None = None
    files: Sequence[Path] = ()
    texts: tuple[tuple[str, str], ...] = ()
    note: str | None = None


class Ledger:
    """Uploads runs and remembers, in a file, what was uploaded.

    Args:
        file: the JSON file; one that belongs to another store is ignored.
        uri: resolved address of the store.
        output: output folder, for the default artifacts and the lock.
        session: the session's id; runs that a killed process had made for it are found again.
    """

    def __init__(self, file: Path, uri: str, output: Path, session: str):
        self._file, self._uri, self._output, self._session = file, uri, output, session
        self._experiments: dict[str, tuple[MlflowClient, str]] = {}
        self.entries: dict[str, Entry] = {}
        if file.exists():
            stored = json.loads(file.read_text())
            if stored["uri"] == uri:
                self.entries = {key: Entry(**entry) for key, entry in stored["runs"].items()}

    def save(self) -> None:
        """Write the file, so that a reader always sees a whole one."""
        runs = {key: asdict(entry) for key, entry in self.entries.items()}
        temporary = self._file.with_suffix(".tmp")
        temporary.write_text(json.dumps({"uri": self._uri, "runs": runs}))
        os.replace(temporary, self._file)

    def upload(self, run: Upload) -> None:
        """Bring one run up to date: create it, add rows beyond the last step, end it when its status says so.

        Raises:
            MlflowException: the store cannot be reached or written now; try again later.
        """
        try:
            self._upload(run)
        except (MlflowException, ValueError) as error:
            if isinstance(error, MlflowException) and error.error_code not in _OF_ONE_RUN:
                raise
            self.entries.setdefault(run.key, Entry(id="")).problem = f"{run.card.name}: {error}"

    def _upload(self, run: Upload) -> None:
        client, experiment = self._open(run.experiment)
        entry = self.entries.get(run.key)
        if entry is None:
            tags = run.card.tags | {KEY_TAG: run.key}
            created = client.create_run(experiment, round(run.card.started * 1000), tags, run.card.name)
            entry = self.entries[run.key] = Entry(created.info.run_id)
        if entry.problem:
            return
        if not entry.described:
            params = [Param(name, value) for name, value in run.card.params.items()]
            for start in range(0, len(params), MAX_PARAMS):
                client.log_batch(entry.id, params=params[start : start + MAX_PARAMS])
            for name, text in run.texts:
                client.log_text(entry.id, text, name)
            entry.described = True
        self._send(client, entry, run)
        if run.status != entry.status:
            if run.note:
                client.set_tag(entry.id, "mlflow.note.content", run.note)
            for file in run.files:
                client.log_artifact(entry.id, str(file))
            if run.status == "RUNNING":
                client.update_run(entry.id, status="RUNNING")
            else:
                client.set_terminated(entry.id, run.status, round((run.finished or run.card.started) * 1000))
            entry.status = run.status

    def _send(self, client: MlflowClient, entry: Entry, run: Upload) -> None:
        rows = [row for row in run.rows if row.step > entry.step]
        metrics = [
            Metric(safe_name(name), value, round((run.card.started + row.seconds) * 1000), row.step)
            for row in rows
            for name, value in row.values.items()
        ]
        # One call costs 3.4 ms, a metric in it 0.09 ms (SQLite): few large batches are what makes it fast.
        for start in range(0, len(metrics), MAX_METRICS):
            client.log_batch(entry.id, metrics=metrics[start : start + MAX_METRICS])
        if rows:
            entry.step, entry.rows = rows[-1].step, entry.rows + len(rows)

    def _open(self, name: str) -> tuple[MlflowClient, str]:
        if name not in self._experiments:
            client, experiment = open_experiment(self._uri, self._output, name)
            self._find_again(client, experiment)
            self._experiments[name] = client, experiment
        return self._experiments[name]

    def _find_again(self, client: MlflowClient, experiment: str) -> None:
        """Adopt the runs that a process made and could not write down before it was killed."""
        token = None
        while True:
            page = client.search_runs(
                [experiment], f"tags.session = '{self._session}'", max_results=MAX_RUNS, page_token=token
            )
            for run in page:
                if key := run.data.tags.get(KEY_TAG):
                    self.entries.setdefault(key, Entry(run.info.run_id, status=run.info.status))
            token = page.token
            if not token:
                return

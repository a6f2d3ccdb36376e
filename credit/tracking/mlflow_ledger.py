"""MLflow runs by a key of ours, and what each of them already holds.

A process that goes on where another was killed asks the store what it has: only the store knows for certain.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import Metric, Param, Run, RunTag
from mlflow.exceptions import MlflowException

from credit.core.naming import metric_name
from credit.tracking.curves import Row
from credit.tracking.describe import MAX_TAG, PARENT, failure
from credit.tracking.entries import Entry, Upload
from credit.tracking.ledger import Ledger
from credit.tracking.store import open_experiment

KEY_TAG, NOTE_TAG = "credit.key", "mlflow.note.content"
MAX_METRICS, MIN_METRICS, MAX_PARAMS, MAX_RUNS = 1000, 50, 100, 1000
# Errors that belong to one run (say, someone deleted it in the UI): the others go on without it.
_OF_ONE_RUN = {"RESOURCE_DOES_NOT_EXIST", "INVALID_PARAMETER_VALUE", "INVALID_STATE", "BAD_REQUEST"}


class MLflowLedger(Ledger):
    """Uploads runs to MLflow; arguments as `Ledger` has them."""

    def __init__(self, file: Path, uri: str, output: Path, session: str):
        super().__init__(file, uri, output, session)
        self._experiments: dict[str, tuple[MlflowClient, str]] = {}
        self._found: dict[str, Run] = {}
        self._known: dict[str, Run] = {}  # the runs that this process made or took up, as they were then
        self._batch = MAX_METRICS

    def forget(self, key: str) -> None:
        """Let go of a run: it is another session's, or the store lost it."""
        super().forget(key)
        for memory in (self._known, self._found):
            memory.pop(key, None)

    def upload(self, run: Upload) -> None:
        """Bring one run up to date: create it, add rows beyond the last step, end it when its status says so.

        Raises:
            Exception: the store cannot be reached or written now, or answers nonsense; try again later.
        """
        try:
            self._upload(run)
        except Exception as error:
            # A request without an answer may have been obeyed: ask anew. Smaller ones may pass where the store is slow.
            self._experiments.pop(run.experiment, None)
            self._batch = max(MIN_METRICS, self._batch // 2)
            if not self._concerns_one(run, error):
                raise
            self.entries[run.key].problem = f"{run.card.name}: {error}"
            self._give_up(run, str(error))

    def _give_up(self, run: Upload, why: str) -> None:
        """Say in the store that it has not everything of a run, which would be running there for ever."""
        with suppress(MlflowException):  # it was deleted
            client, _ = self._open(run.experiment)
            entry = self.entries[run.key]
            lacking = f"MLflow did not take everything of this run: {why}"
            client.set_tag(entry.id, NOTE_TAG, failure(run.card.description, lacking)[:MAX_TAG])
            client.set_terminated(entry.id, "FAILED", round((run.finished or run.card.started) * 1000))

    def _concerns_one(self, run: Upload, error: Exception) -> bool:
        """Whether the store is well and refuses this one run; raises where it is wrong about everything."""
        code = error.error_code if isinstance(error, MlflowException) else None
        if run.key not in self._known or code not in _OF_ONE_RUN:
            return False
        client, _ = self._open(run.experiment)
        found = _ask(client, self.entries[run.key].id)
        if found is None:
            self.forget(run.key)
            return False
        return found.info.lifecycle_stage == "deleted" or code != "RESOURCE_DOES_NOT_EXIST"

    def _upload(self, run: Upload) -> None:
        client, experiment = self._open(run.experiment)
        if run.key not in self._known:
            self._begin(client, experiment, run)
        entry = self.entries[run.key]
        if entry.problem:
            return
        if not entry.described:
            for name, text in run.texts:
                client.log_text(entry.id, text, name)
            has = self._known[run.key].data.params  # what a run has cannot be changed
            lacking = [Param(name, value) for name, value in run.card.params.items() if name not in has]
            for start in range(0, len(lacking), MAX_PARAMS):
                client.log_batch(entry.id, params=lacking[start : start + MAX_PARAMS])
            entry.described = True
        parent = run.card.tags.get(PARENT)
        if parent and parent != entry.parent:
            client.set_tag(entry.id, PARENT, parent)
            entry.parent = parent
        self._send(client, entry, run)
        if run.status != entry.status:
            if run.error or entry.status not in ("RUNNING", "FINISHED"):  # of an earlier attempt
                client.set_tag(entry.id, NOTE_TAG, _note_of(run))
            for file in run.files:
                client.log_artifact(entry.id, str(file))
            if picture := run.picture():
                client.log_text(entry.id, picture, "recovery.svg")
            if run.status == "RUNNING":
                client.update_run(entry.id, status="RUNNING")
            else:
                client.set_terminated(entry.id, run.status, round((run.finished or run.card.started) * 1000))
            entry.status = run.status

    def _begin(self, client: MlflowClient, experiment: str, run: Upload) -> None:
        """Take up the run that an earlier process made, or make one."""
        found = self._found.pop(run.key, None) or self._noted(client, experiment, run)
        entry = self.entries.get(run.key)
        if found is None and entry is not None:
            found = _ask(client, entry.id)
            if found is not None and found.info.lifecycle_stage == "deleted":
                entry.problem = f"{run.card.name}: the run {entry.id} was deleted in MLflow"
                self._known[run.key] = found
                return
        if found is None:
            self._write_note(run, "")  # first: a run that is made and not written down is found by it
            tags = run.card.tags | {KEY_TAG: run.key, NOTE_TAG: _note_of(run)}
            found = client.create_run(experiment, round(run.card.started * 1000), tags, run.card.name)
            if not found.info.run_id:
                raise RuntimeError(f"{self._uri} answers, but not as an MLflow server does")
        else:
            tags = run.card.tags | {KEY_TAG: run.key}
            client.log_batch(found.info.run_id, tags=[RunTag(name, value) for name, value in tags.items()])
        self.entries[run.key] = Entry(
            id=found.info.run_id,
            started=found.info.start_time,
            described=set(run.card.params) <= set(found.data.params),
            status=found.info.status,
            parent=run.card.tags.get(PARENT),
        )
        self._known[run.key] = found
        self._write_note(run, found.info.run_id)

    def _noted(self, client: MlflowClient, experiment: str, run: Upload) -> Run | None:
        """The run that another session began in this folder, and did not finish."""
        note = self._note(run)
        if note is None:
            return None
        if note.run:
            found = _ask(client, note.run)
        else:
            chosen = f"tags.session = '{note.session}' and tags.`{KEY_TAG}` = '{note.key}'"
            found = next(iter(client.search_runs([experiment], chosen, max_results=1)), None)
        if found is None or found.info.lifecycle_stage == "deleted":
            return None
        # What was finished and is computed again is another run.
        return found if found.info.status != "FINISHED" or note.session == self._session else None

    def _send(self, client: MlflowClient, entry: Entry, run: Upload) -> None:
        held = {metric.key: metric.step for metric in self._known[run.key].data._metric_objs}
        # One call costs 3.4 ms, a metric in it 0.09 ms (SQLite): few large batches are what makes it fast.
        for rows in _parts(run.rows(entry.step), self._batch):
            metrics = [
                Metric(name, value, entry.started + round(1000 * row.seconds), row.step)
                for row in rows
                for name, value in ((metric_name(name), value) for name, value in row.values.items())
                if row.step > held.get(name, -1)
            ]
            for start in range(0, len(metrics), MAX_METRICS):
                client.log_batch(entry.id, metrics=metrics[start : start + MAX_METRICS])
            entry.step, entry.rows = rows[-1].step, entry.rows + len(rows)
            self.sent += len({metric.step for metric in metrics})
            self._batch = min(2 * self._batch, MAX_METRICS)

    def _open(self, name: str) -> tuple[MlflowClient, str]:
        if name not in self._experiments:
            client, experiment = open_experiment(self._uri, self._output, name)
            self._find_again(client, experiment)
            self._experiments[name] = client, experiment
        return self._experiments[name]

    def _find_again(self, client: MlflowClient, experiment: str) -> None:
        """Find the runs that a process made and could not write down before it was killed, or cut off."""
        chosen, token, ours = f"tags.session = '{self._session}'", None, defaultdict[str, list[Run]](list)
        while True:
            page = client.search_runs([experiment], chosen, max_results=MAX_RUNS, page_token=token)
            for run in page:
                if key := run.data.tags.get(KEY_TAG):
                    ours[key].append(run)
            token = page.token
            if not token:
                break
        for key, twins in ours.items():
            known = self.entries[key].id if key in self.entries else None
            best = max(twins, key=lambda run: (run.info.run_id == known, len(run.data.metrics)))
            if key not in self._known:
                self._found[key] = best
            for run in twins:
                if run is not best:  # its maker got no answer, and made another
                    client.delete_run(run.info.run_id)


def _note_of(run: Upload) -> str:
    said = failure(run.card.description, run.error) if run.error else run.card.description
    return said[:MAX_TAG]


def _ask(client: MlflowClient, identity: str) -> Run | None:
    """A run by its id, deleted ones too; None where the store never heard of it."""
    try:
        return client.get_run(identity)
    except MlflowException as error:
        if error.error_code == "RESOURCE_DOES_NOT_EXIST":
            return None
        raise


def _parts(rows: Sequence[Row], size: int) -> Iterator[list[Row]]:
    """Rows in parts of about `size` values."""
    part: list[Row] = []
    values = 0
    for row in rows:
        if part and values + len(row.values) > size:
            yield part
            part, values = [], 0
        part.append(row)
        values += len(row.values)
    if part:
        yield part

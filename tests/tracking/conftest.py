from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mlflow import MlflowClient
from mlflow.entities import Run

from credit.tracking import Seeds
from credit.tracking.mirror import Mirror
from credit.tracking.store import open_experiment, resolve_uri

NAN = float("nan")
STARTED = 1_700_000_000.0


class FakeSession:
    """Writes a session's journal the way a trainer does."""

    def __init__(
        self,
        output: Path,
        kind: str = "sweep",
        experiment: str = "advertiser",
        identifier: str = "20261122-201500-3f2a",
    ):
        self.output, self.experiment, self.jobs = output, experiment, 0
        self.id = identifier
        self.folder = output / "sessions" / self.id
        self.folder.mkdir(parents=True)
        self._session: dict[str, Any] = {
            "id": self.id,
            "kind": kind,
            "experiment": experiment,
            "command": f"credit train -m experiment={experiment}",
            "started": STARTED,
            "finished": None,
            "status": "RUNNING",
            "host": "box",
            "pid": 1,
            "process_started": STARTED - 1,
            "tracking": {"uri": None, "seeds": "auto"},
        }
        self._write("session", self._session)

    def end(self, status: str = "FINISHED", finished: float = STARTED + 100) -> None:
        self._write("session", self._session | {"status": status, "finished": finished})

    def go_on(self) -> None:
        """The same command again, in another process."""
        self._session |= {"pid": self._session["pid"] + 1, "process_started": STARTED + 50}
        self._write("session", self._session)

    def job(self, method: str, seeds: Sequence[int]) -> FakeJob:
        self.jobs += 1
        return FakeJob(self, method, seeds, self.jobs - 1)

    def _write(self, name: str, content: dict[str, Any]) -> None:
        temporary = self.folder / f"{name}.tmp"
        temporary.write_text(json.dumps(content))
        temporary.replace(self.folder / f"{name}.json")


class FakeJob:
    """One job of a fake session."""

    def __init__(self, session: FakeSession, method: str, seeds: Sequence[int], number: int):
        self.session, self.seeds = session, list(seeds)
        self.started = STARTED + 10 * number
        folders = [f"{session.experiment}/{method}/default/seed-{seed}" for seed in seeds]
        self.folders = [session.output / folder for folder in folders]
        self.content: dict[str, Any] = {
            "id": f"{session.id}-{number}",
            "session": session.id,
            "number": number,
            "experiment": session.experiment,
            "method": method,
            "slug": "default",
            "env": "advertiser",
            "seeds": self.seeds,
            "folders": folders,
            "status": "RUNNING",
            "started": self.started,
            "finished": None,
            "error": None,
            "config_hash": "abc123",
            "git_commit": "0" * 40,
            "config": {
                "method": method,
                "seed": self.seeds[0],
                "env": {"_target_": "credit.envs.advertiser.environment.Advertiser", "size": 10, "noise": None},
                "on": True,
            },
            "overrides": [f"method={method}"],
        }
        for folder, seed in zip(self.folders, self.seeds, strict=True):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "config.yaml").write_text(yaml.safe_dump(self.content["config"] | {"seed": seed}))
        session._write(f"job-{number}", self.content)

    def go_on(self) -> None:
        """The job runs again."""
        self.session._write(f"job-{self.content['number']}", self.content)

    def header(self, names: Sequence[str]) -> None:
        for folder in self.folders:
            (folder / "metrics.csv").write_text(",".join(["step", *names]) + "\n")

    def row(self, step: int, *values: Sequence[float]) -> None:
        """One row per seed; NaN becomes an empty cell."""
        for folder, cells in zip(self.folders, values, strict=True):
            text = ",".join([str(step), *("" if np.isnan(cell) else repr(float(cell)) for cell in cells)])
            with (folder / "metrics.csv").open("a") as file:
                file.write(text + "\n")

    def end(self, status: str = "FINISHED", error: str | None = None) -> None:
        finished = self.started + 9
        number = self.content["number"]
        if status == "FINISHED":
            for folder, seed in zip(self.folders, self.seeds, strict=True):
                summary = {"session": self.session.id, "seed": seed, "status": status, "finished": finished}
                (folder / "summary.json").write_text(json.dumps(summary | {"started": self.started}))
                np.savez(folder / "recovery.npz", **{"policy": np.zeros(10), "reward/mixed": np.eye(10, 3)})
        ending = {"status": status, "finished": finished, "error": error}
        self.session._write(f"job-{number}", self.content | ending)


class Store:
    """A tracking store, read back."""

    def __init__(self, session: FakeSession, uri: str):
        self.session, self.uri = session, uri
        self.client = MlflowClient(uri)

    def mirror(self, seeds: Seeds = "auto") -> Mirror:
        return Mirror(self.session.output, self.session.folder, self.uri, seeds)

    def runs(self, level: str) -> dict[str, Run]:
        experiment = self.client.get_experiment_by_name("advertiser")
        assert experiment is not None
        found = self.client.search_runs([experiment.experiment_id], f"tags.level = '{level}'")
        names = [f"{run.data.tags.get('method', '')}/{run.info.run_name}" for run in found]
        assert len(set(names)) == len(names), "a run is there twice"
        return dict(zip(names, found, strict=True))

    def curve(self, run: Run, metric: str) -> list[tuple[int, float, float]]:
        """(step, value, seconds since the session's start) of every point."""
        points = self.client.get_metric_history(run.info.run_id, metric)
        return sorted((point.step, point.value, point.timestamp / 1000 - STARTED) for point in points)

    def files(self, run: Run) -> set[str]:
        return {file.path for file in self.client.list_artifacts(run.info.run_id)}


@pytest.fixture
def session(tmp_path: Path) -> FakeSession:
    return FakeSession(tmp_path / "outputs")


@pytest.fixture(scope="session")
def fresh_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A SQLite store with its schema, made once: the migration takes over a second."""
    output = tmp_path_factory.mktemp("store")
    open_experiment(resolve_uri(None, output), output, "fresh")
    return output / "mlflow.db"


@pytest.fixture
def uri(tmp_path: Path, fresh_store: Path) -> str:
    """The address of an empty store, that of the output folder."""
    output = tmp_path / "outputs"
    output.mkdir(exist_ok=True)
    shutil.copy(fresh_store, output / "mlflow.db")
    return resolve_uri(None, output)


@pytest.fixture
def store(session: FakeSession, uri: str) -> Store:
    return Store(session, uri)

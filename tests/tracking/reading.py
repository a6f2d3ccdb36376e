"""A tracking store compared with the journals, row for row."""

from __future__ import annotations

import csv
import math
from collections import Counter
from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import Run

from credit.tracking.notes import Note


def all_runs(uri: str, level: str) -> list[Run]:
    client = MlflowClient(uri)
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    found, token = [], None
    while True:
        page = client.search_runs(experiments, f"tags.level = '{level}'", max_results=1000, page_token=token)
        found += page
        token = page.token
        if not token:
            return found


def journal(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """Metric → (step, value) of every finite cell, in the order of the file."""
    curves: dict[str, list[tuple[int, float]]] = {}
    with (folder / "metrics.csv").open() as file:
        for row in csv.DictReader(file):
            for name, cell in row.items():
                if name != "step" and cell and math.isfinite(float(cell)):
                    curves.setdefault(name, []).append((int(row["step"]), float(cell)))
    return curves


def stored(client: MlflowClient, run: Run) -> dict[str, list[tuple[int, float]]]:
    histories = {name: client.get_metric_history(run.info.run_id, name) for name in run.data.metrics}
    return {name: sorted((point.step, point.value) for point in points) for name, points in histories.items()}


def assert_equal_to_journals(uri: str, output: Path, exact_times: bool = True) -> int:
    """Every run folder is one MLflow run with its rows, each once; the rows of all of them together.

    A seed that was computed again from the start has the wall times of its first attempt in the store.
    """
    client = MlflowClient(uri)
    folders = sorted(path.parent for path in output.glob("*/*/*/seed-*/metrics.csv"))
    seeds = {run.info.run_id: run for run in all_runs(uri, "seed")}
    notes = {folder: Note.read(folder) for folder in folders}
    assert sorted(note.run for note in notes.values() if note) == sorted(seeds), "a run is twice, missing, or nobody's"
    rows = 0
    for folder, note in notes.items():
        assert note is not None
        here, there = journal(folder), stored(client, seeds[note.run])
        if not exact_times:
            assert [step for step, _ in there.pop("time/seconds")] == [step for step, _ in here.pop("time/seconds")]
        assert there == here, folder
        rows += len(next(iter(here.values())))
    names = Counter((run.data.tags["session"], run.data.tags["job"]) for run in all_runs(uri, "job"))
    assert set(names.values()) == {1}, "a job is twice"
    for run in all_runs(uri, "job"):
        members = [seed for seed in seeds.values() if seed.data.tags["mlflow.parentRunId"] == run.info.run_id]
        means = stored(client, run)
        for name, points in means.items():
            assert len({step for step, _ in points}) == len(points), f"{name} has a step twice"
        if members:
            curves = [stored(client, seed) for seed in members]
            for name in set.intersection(*(set(curve) for curve in curves)):
                common = set.intersection(*({step for step, _ in curve[name]} for curve in curves))
                assert {step for step, _ in means.get(name, [])} == common, name
    return rows

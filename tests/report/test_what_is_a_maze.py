"""A maze is told by its environment or by what its runs keep; names of metrics are free."""

import re
from pathlib import Path

import numpy as np
import pytest

from credit.report.compare import compare
from credit.report.comparison import summarise
from credit.report.figures import curves_figure
from credit.report.runs import load_runs
from credit.report.text import caption

from .conftest import ENV, WriteRun
from .mazes import journal, write_maze_run

SUCCESS = {"eval/success": 0.8, "eval/final": 0.75, "eval/auc": 0.5, "eval/learned": 3.0, "eval/lost": 1.0}


def write_all(write_run: WriteRun, metrics: dict[str, float], *, keeps: bytes | None = None) -> None:
    for method in ("reference", "disagreement"):
        for seed in range(3):
            own = {name: value * (1 + seed / 10) for name, value in metrics.items()}
            folder = write_run(method, seed, own, experiment="walker", env={**ENV, "_target_": "mine.envs.Walker"})
            if keeps is not None:
                (folder / "trajectories.npz").write_bytes(keeps)


@pytest.mark.parametrize("keeps", [None, b"PK", b"nothing of ours"])
def test_metrics_of_a_maze_make_no_maze(write_run: WriteRun, tmp_path: Path, keeps: bytes | None):
    write_all(write_run, SUCCESS, keeps=keeps)
    report = compare(tmp_path / "outputs", "walker")
    (comparison,) = report.comparisons
    assert not comparison.is_maze
    assert comparison.primary.title == "Success in the last four rounds"
    assert {path.stem for path in report.files} == {"table", "runs", "curves", "distribution"}
    figure = curves_figure(report.comparisons)
    assert figure is not None
    assert figure.get_supxlabel().startswith("Primitive environment steps")


def test_arrays_of_another_kind_are_no_maze(write_run: WriteRun, tmp_path: Path):
    write_all(write_run, SUCCESS)
    for folder in (tmp_path / "outputs" / "walker").glob("*/*/seed-*"):
        np.savez(folder / "trajectories.npz", places=np.zeros(3))
    assert not compare(tmp_path / "outputs", "walker").comparisons[0].is_maze


@pytest.mark.thorough
def test_whose_runs_keep_a_maze_is_one(tmp_path: Path):
    write_maze_run(tmp_path, "delayed", 0, [0.5, 0.9], tracks=journal(), env={"_target_": "mine.envs.Labyrinth"})
    report = compare(tmp_path, "pointmaze", videos=False)
    assert report.comparisons[0].is_maze
    assert "trajectories_delayed.png" in {path.name for path in report.files}


def test_policies_without_success_are_judged_by_their_return(write_run: WriteRun, tmp_path: Path):
    write_all(write_run, {"eval/return": 80.0, "eval/final": 75.0, "eval/auc": 50.0, "eval/length": 9.0})
    comparison = summarise(load_runs(tmp_path / "outputs", "walker"))
    assert [measure.title for measure in comparison.measures] == ["Return in the last four rounds", "AUC of return"]
    assert [measure.metric for measure in comparison.curves] == ["eval/return"]
    told = caption(comparison)
    assert "AUC is the mean return over all rounds" in told
    assert not re.search("success|lost|averaged", told)


def test_a_return_alone_is_enough(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, {"eval/return": 80.0, "return/label": 3.0}, experiment="walker")
    assert summarise(load_runs(tmp_path / "outputs", "walker")).primary.metric == "eval/return"

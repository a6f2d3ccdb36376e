"""`credit train` as a user types it."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

import credit as package

SHORT = ("trainer.steps=700", "trainer.log_every=20", "tracking=none")
ROOT = Path(package.__file__).resolve().parents[1]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_job_leaves_complete_runs(credit, folder):
    ended = credit("train", "method=disagreement", "seed=3", "replicas=2", *SHORT)
    assert ended.code == 0
    parent = folder / "outputs/advertiser/disagreement/trainer.log_every=20,trainer.steps=700"
    assert sorted(path.name for path in parent.iterdir()) == ["seed-3", "seed-4"]
    for seed in (3, 4):
        run = parent / f"seed-{seed}"
        assert sorted(path.name for path in run.iterdir()) == [
            "DONE",
            "config.yaml",
            "metrics.csv",
            "policy.pt",
            "recovery.npz",
            "summary.json",
        ]
        journal = rows(run / "metrics.csv")
        assert [int(row["step"]) for row in journal] == [140, 280, 420, 560, 700]
        summary = json.loads((run / "summary.json").read_text())
        assert summary["status"] == "FINISHED"
        assert summary["seed"] == seed
        assert summary["metrics"]["regret/cumulative"] == float(journal[-1]["regret/cumulative"])
        assert (run / "DONE").read_text().strip() == summary["config_hash"]
    assert f"runs     {parent.relative_to(folder)}/seed-*" in ended.out
    assert "credit compare experiment=advertiser" in ended.out


def test_the_same_command_does_only_what_is_missing(credit, folder):
    credit("train", "method=random", "replicas=2", *SHORT)
    first = {path: path.stat().st_mtime_ns for path in folder.rglob("metrics.csv")}
    ended = credit("train", "method=random", "replicas=3", *SHORT)
    assert ended.code == 0
    assert "1 seeds" in ended.err
    assert "2 already done" in ended.err
    assert {path: path.stat().st_mtime_ns for path in first} == first
    assert len(list(folder.rglob("DONE"))) == 3


@pytest.mark.thorough
def test_one_spelling_of_a_number_is_one_folder(credit, folder):
    credit("train", "method=random", "replicas=1", "env.p_up=.5", *SHORT)
    ended = credit("train", "-m", "method=random", "replicas=1", "env.p_up=.5,.4", "hydra/launcher=basic", *SHORT)
    assert "all 1 seeds were done before" in ended.err
    assert len(list(folder.rglob("DONE"))) == 2


def test_python_returns_the_metrics_of_all_seeds(folder):
    words = ["method=random", *SHORT]
    first = package.run([*words, "replicas=2"]).metrics["regret/cumulative"]
    again = package.run([*words, "replicas=3"])
    assert again.skipped == [0, 1]
    assert again.metrics["regret/cumulative"].shape == (3,)
    assert again.metrics["regret/cumulative"][:2].tolist() == first.tolist()
    assert package.load(again.folders[2]).summary["seed"] == 2


def test_an_interrupted_call_from_python_leaves_no_running_session(folder):
    def interrupt(title: str, steps: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        package.run(["method=random", "replicas=1", *SHORT], progress=interrupt)
    session = next((folder / "outputs/sessions").iterdir())
    for name in ("session.json", "job-0.json"):
        assert json.loads((session / name).read_text())["status"] == "KILLED"


def test_a_seed_goes_alone_as_in_a_batch(credit, folder):
    credit("train", "method=disagreement", "replicas=3", *SHORT)
    credit("train", "method=disagreement", "seed=1", "output=alone", "replicas=1", *SHORT)
    place = "advertiser/disagreement/trainer.log_every=20,trainer.steps=700/seed-1/metrics.csv"
    batch, alone = rows(folder / "outputs" / place), rows(folder / "alone" / place)
    assert len(batch) == len(alone) == 5
    for mine, theirs in zip(alone, batch, strict=True):
        assert mine.keys() == theirs.keys()
        for name in mine.keys() - {"time/seconds"}:
            assert float(mine[name]) == pytest.approx(float(theirs[name]), rel=1e-7, abs=1e-9), name


@pytest.mark.thorough
def test_another_configuration_is_never_overwritten(credit, folder):
    place = ("--config-dir", "mine", "env=mine")
    file = folder / "mine/env/mine.yaml"
    file.parent.mkdir(parents=True)
    file.write_text("_target_: credit.envs.advertiser.environment.Advertiser\np_up: 0.6\n")
    assert credit("train", *place, "method=random", "replicas=1", *SHORT).code == 0
    before = next(folder.rglob("metrics.csv")).read_bytes()
    file.write_text("_target_: credit.envs.advertiser.environment.Advertiser\np_up: 0.5\n")
    ended = credit("train", *place, "method=random", "replicas=1", *SHORT)
    assert ended.code == 2
    assert "env.p_up: 0.6 → 0.5" in ended.err
    assert "rerun=true" in ended.err
    assert next(folder.rglob("metrics.csv")).read_bytes() == before
    assert credit("train", *place, "method=random", "replicas=1", "rerun=true", *SHORT).code == 0
    assert next(folder.rglob("metrics.csv")).read_bytes() != before


@pytest.mark.thorough
def test_a_sweep_runs_every_job(credit, folder):
    ended = credit("train", "-m", "method=delayed,reference", "replicas=2", "hydra/launcher=basic", *SHORT)
    assert ended.code == 0
    assert len(list(folder.rglob("DONE"))) == 4
    session = next((folder / "outputs/sessions").iterdir())
    assert json.loads((session / "session.json").read_text())["kind"] == "sweep"
    jobs = [json.loads((session / f"job-{number}.json").read_text()) for number in (0, 1)]
    assert [job["method"] for job in jobs] == ["delayed", "reference"]
    assert {job["status"] for job in jobs} == {"FINISHED"}


def test_infinite_labels_stop_the_run(credit, folder):
    ended = credit("train", "method=reference", "replicas=2", "env.gain=1e308", *SHORT)
    assert ended.code == 1
    assert "window 1 of seed 0 has the label inf" in ended.err
    run = next(folder.rglob("seed-0"))
    assert not (run / "DONE").exists()
    assert json.loads((run / "summary.json").read_text())["status"] == "FAILED"
    session = next((folder / "outputs/sessions").iterdir())
    assert json.loads((session / "session.json").read_text())["status"] == "FAILED"
    assert "Traceback" in (session / "job-0.log").read_text()


def test_check_and_list_and_help_build_nothing(credit, folder):
    assert "# all right" in credit("check", "method=block").out
    assert "# 2 jobs, all right" in credit("check", "-m", "method=block,random").out
    explained = credit("check", "--explain", "experiment=sepsis").out
    assert any(line.split() == ["mixer.alpha", "1.0", "experiment=sepsis"] for line in explained.splitlines())
    assert "--explain is of one job" in credit("check", "-m", "--explain", "method=block,random").err
    listing = credit("list").out
    for name in (
        "disagreement",
        "elliptical",
        "threshold",
        "alpha = 0.5   (float > 0; 0.3 in generic_control, generic_discrete, pointmaze, pointmaze_paper, 1.0 in",
    ):
        assert name in listing
    for words in (
        (),
        ("train", "--help"),
        ("compare", "--help"),
        ("dashboard", "--help"),
        ("bench", "--help"),
    ):
        ended = credit(*words) if words else credit("--help")
        assert ended.code == 0
        assert "credit" in ended.out
    assert "local_mse" in credit("train", "--help").out
    assert list(folder.iterdir()) == []


@pytest.mark.thorough
def test_the_module_is_the_command(folder):
    done = subprocess.run(
        [sys.executable, "-m", "credit.cli.train", "method=disagrement"],
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "did you mean 'disagreement'" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []

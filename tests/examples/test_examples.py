"""Every example runs, makes no folders, needs neither Hydra nor MLflow, and says something that is true."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import credit

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
ALONE = """
import runpy, sys
runpy.run_path({path!r}, run_name="__main__")
assert not {{"hydra", "omegaconf", "mlflow", "matplotlib"}} & {{*sys.modules}}
"""


def output_of(name: str, folder: Path) -> list[str]:
    """The lines that an example prints, run by itself in an empty folder."""
    code = ALONE.format(path=str(EXAMPLES / name))
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert list(folder.iterdir()) == []
    return done.stdout.splitlines()


def numbers(line: str) -> list[float]:
    return [float(text) for text in re.findall(r"[-+]?\d+\.\d+", line)]


def test_there_is_a_test_for_every_example() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    notebooks = (EXAMPLES.parent / "tests" / "docs" / "test_notebook.py").read_text(encoding="utf-8")
    names = [path.name for path in EXAMPLES.iterdir() if path.name != "__pycache__"]
    assert [name for name in names if f'"{name}"' not in text + notebooks] == []


def test_rewards_are_recovered_from_windows(tmp_path: Path) -> None:
    days, ridge, linear, _, last = output_of("recover_rewards.py", tmp_path)
    assert "1050 days" in days
    assert 0.98 < numbers(ridge)[-1] + numbers(linear)[-1] < 1.02  # weights
    error, span = numbers(last)
    assert error < 0.05 * span


@pytest.mark.thorough
def test_sac_learns_from_transitions(tmp_path: Path) -> None:
    told, *asked = output_of("sac_on_transitions.py", tmp_path)
    assert "after 600 updates" in told
    assert len(asked) == 4
    assert all(place * push < -0.2 * abs(place) for place, push in map(numbers, asked))  # back to 0


@pytest.mark.thorough
def test_labels_are_made_of_rewards(tmp_path: Path) -> None:
    lines = output_of("make_labels.py", tmp_path)
    sums, last, success, rounded = (numbers(line) for line in lines)
    assert [line.split()[0] for line in lines] == ["BlockSum", "Terminal", "Success", "Rounded"]
    assert rounded == [(round(label) > 0) - (round(label) < 0) for label in sums]  # but for its noise
    assert {*last} <= {-1.0, 0.0, 1.0}
    assert all(one in (0, 1) for one in success)
    assert any(sums)


@pytest.mark.thorough
def test_episodes_until_watch_repair_is_solved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "env=watch_repair",
        "method=reference",
        "bonus=[]",
        "trainer.log_every=1",
        "trainer.steps=500",
        "replicas=2",
    ]
    run = credit.run([*words, f"output={tmp_path}", "tracking=none"])
    example = runpy.run_path(str(EXAMPLES / "episodes_to_solve.py"))
    right = pd.DataFrame({"return/greedy": [0.0] * 3 + [example["OPTIMUM"]] * 96})
    right.index = pd.Index(range(500, 50_000, 500))  # steps: ten episodes between two looks
    one = dataclasses.replace(credit.load(run.folders[0]), metrics=right)
    assert example["solved"](one) == 750  # of 75 looks three may be wrong, and the first three are
    wrong = right.assign(**{"return/greedy": 0.0})
    assert example["solved"](dataclasses.replace(one, metrics=wrong)) == float("inf")
    example["main"](tmp_path / "watch_repair")
    assert "0 of 2 seeds; regret" in capsys.readouterr().out


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """What `pip install -e examples/own_surrogate` leaves: where it lies, and what it announces."""
    project = tomllib.loads((EXAMPLES / "own_surrogate" / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    facts = tmp_path / "site" / "credit_season-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = [
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in own.items())
        for group, own in project["entry-points"].items()
    ]
    (facts / "entry_points.txt").write_text("\n".join(points))
    return facts.parent


@pytest.mark.thorough
def test_a_surrogate_of_ones_own_is_listed_and_runs(site: Path, tmp_path: Path) -> None:
    path = os.pathsep.join(map(str, (EXAMPLES / "own_surrogate", site, ROOT)))

    def credit(*words: str) -> str:
        command = [sys.executable, "-m", "credit.cli.main", *words]
        environment = os.environ | {"PYTHONPATH": path}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "one reward for each action in low and in high season" in credit("list", "reward")
    credit("train", "+reward@surrogates.season=season", "replicas=1", "trainer.steps=210", "tracking=none")
    summary = json.loads(next(tmp_path.rglob("seed-0/summary.json")).read_text(encoding="utf-8"))
    assert 0 < summary["metrics"]["weight/season"] < 1


def test_steps_are_recovered_from_episodes(capsys: pytest.CaptureFixture[str]) -> None:
    found = runpy.run_path(str(EXAMPLES / "recover_steps.py"))["main"]()
    assert found["correlation"] > 0.85
    assert found["network"] + found["speed"] == pytest.approx(1, abs=1e-4)
    assert "correlation" in capsys.readouterr().out


@pytest.mark.thorough
def test_labels_come_late(tmp_path: Path) -> None:
    *labels, last = output_of("late_labels.py", tmp_path)
    assert labels
    assert all(4 < label == reward < 6 for label, reward in map(numbers, labels))
    assert "a window ends without a label" in last


def test_an_agent_of_stable_baselines_learns_from_recovered_rewards(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3")
    assert runpy.run_path(str(EXAMPLES / "sb3_agent.py"))["main"](1_010) > 0.9
    assert "1000 steps, 50 labels" in capsys.readouterr().out


@pytest.mark.thorough
def test_a_torchrl_buffer_samples_recovered_rewards(capsys: pytest.CaptureFixture[str]) -> None:
    found = runpy.run_path(str(EXAMPLES / "torchrl_buffer.py"))["main"]()
    assert -3 < found[-1] < 1
    assert found[-100] < -80
    assert "on average" in capsys.readouterr().out


@pytest.mark.slow
def test_an_environment_of_ones_own_is_learned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(EXAMPLES / "own_environment.py"))["main"](1)
    assert {*found} == {"random", "reference"}
    assert all(-40 < earned < 40 for earned in found.values())
    assert "earns" in capsys.readouterr().out
    assert len([*tmp_path.glob("outputs/Kiosk-v0/*/*/seed-0/DONE")]) == 2


@pytest.mark.thorough
def test_the_marketing_panel_is_made_as_it_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "marketing.csv"
    command = [sys.executable, str(EXAMPLES / "marketing.py"), str(file)]
    subprocess.run(command, check=True, capture_output=True)
    pd.testing.assert_frame_equal(pd.read_csv(file), pd.read_csv(EXAMPLES / "marketing.csv"))


@pytest.mark.thorough
def test_coverage_is_of_a_truth_that_is_known() -> None:
    study = runpy.run_path(str(EXAMPLES / "marketing_coverage.py"))
    effects = study["one"](1, regions=6, weeks=60, draws=20)
    assert {*effects["model"]} == {"reference", "actions", "mixture"}
    tv = effects[(effects["action"] == "tv") & (effects["model"] == "mixture")].iloc[0]
    assert tv["truth"] == pytest.approx(4.5, rel=0.05)
    assert tv["per_unit"] == pytest.approx(tv["truth"], rel=0.2)
    assert study["shown"](effects)["count"].eq(1).all()


def test_real_series_are_judged_within_windows() -> None:
    example = runpy.run_path(str(EXAMPLES / "real_series.py"))
    window = np.repeat(np.arange(30), 4)
    truth = np.random.default_rng(0).normal(size=120) + window
    label = np.bincount(window, truth)[window]
    smooth = example["denton"](label, window)
    np.testing.assert_allclose(np.bincount(window, smooth), np.bincount(window, truth), rtol=1e-9)
    alike = example["judged"](truth, label / 4, window)
    assert (alike["within"], alike["within_rmse"]) == (0.0, pytest.approx(1.0))
    assert alike["total"] > 0.9  # for nothing
    within = truth - (np.bincount(window, truth) / 4)[window]
    plain = np.corrcoef(within, within + (truth**2 - (np.bincount(window, truth**2) / 4)[window]))[0, 1]
    found = example["judged"](truth, truth + truth**2, window)
    assert found["within"] == pytest.approx(plain)
    assert found["within_low"] < found["within"] < found["within_high"]


def test_panels_of_another_simulator_have_a_truth_that_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pysimmmulator")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    example = runpy.run_path(str(EXAMPLES / "pysimmmulator_coverage.py"))
    rows, truth = example["panel"](1)
    assert len(rows) % 7 == 0
    assert rows.groupby("week")["revenue"].nunique().max() == 1
    for name, (decay, conversions, *_) in example["CHANNELS"].items():
        assert truth[name] == pytest.approx(10 * conversions / (1 - decay), rel=0.15)  # 10 is what a conversion earns

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from credit.cli.compare import main
from credit.core.errors import UserError
from credit.report.compare import compare
from credit.report.comparison import summarise
from credit.report.distribution import distribution_figure
from credit.report.heatmaps import heatmaps_figure
from credit.report.recovered import recovered_maps
from credit.report.runs import load_runs
from credit.report.style import SPARE, colours, save
from credit.runs.palette import COLOURS

from .conftest import WriteRun, recovery_arrays


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for seed in range(4):
        for method, regret in {"block": 2000.0, "reference": 90.0, "disagreement": 80.0}.items():
            mse = None if method == "block" else 0.002
            arrays = recovery_arrays(rng) if method == "disagreement" else None
            regret += (-1) ** seed if method == "disagreement" else 0
            metrics = {"regret/cumulative": regret + seed, "reward/mse": mse}
            write_run(method, seed, metrics, recovery=arrays)
    return tmp_path / "outputs"


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes most of the time of a comparison."""
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})


def test_names_with_dollars_are_drawn_as_they_are(write_run: WriteRun, tmp_path: Path):
    for method, title in (("block", "$$ loss $x_{$"), ("reference", "[v2] 100 %")):
        for seed in range(3):
            folder = write_run(method, seed, {"regret/cumulative": 10.0 ** (seed + 1)})
            file = folder / "summary.json"
            file.write_text(json.dumps(json.loads(file.read_text()) | {"paper": {"name": title}}))
    report = compare(tmp_path / "outputs", "advertiser")
    assert "$$ loss $x_{$" in (report.folder / "table.md").read_text()
    assert (report.folder / "curves.png").stat().st_size > 100
    assert "mathdefault" not in (report.folder / "distribution.svg").read_text()


def test_compare_writes_tables_and_figures(output: Path):
    report = compare(output, "advertiser")
    figures = [f"{name}.{ending}" for name in ("curves", "distribution", "diagnostics") for ending in ("png", "svg")]
    assert report.folder == output / "reports" / "advertiser"
    assert [path.name for path in report.files] == [
        "table.md",
        "table.csv",
        "table.tex",
        "runs.csv",
        *figures,
    ]
    assert all(path.stat().st_size > 100 for path in report.files)
    runs = pd.read_csv(report.folder / "runs.csv")
    assert list(runs) == [
        "method", "slug", "seed", "config_hash", "git_commit", "version", "regret/cumulative", "reward/mse",
    ]  # fmt: skip
    assert len(runs) == 12
    assert runs.loc[runs["method"] == "block", "regret/cumulative"].tolist() == [
        2000.0,
        2001.0,
        2002.0,
        2003.0,
    ]


@pytest.mark.thorough
def test_the_same_runs_give_the_same_files(output: Path):
    first = [path.read_bytes() for path in compare(output, "advertiser").files]
    assert first == [path.read_bytes() for path in compare(output, "advertiser").files]


def test_heat_maps_of_one_seed_and_of_the_mean(output: Path):
    runs = load_runs(output, "advertiser")
    maps = [recovered_maps(runs), recovered_maps(runs, seed=2)]
    mean, one = [heatmaps_figure(each) for each in maps if each is not None]
    assert mean.get_suptitle() == "advertiser: Disagreement-UCB, end of training, mean over 4 seeds"
    assert one.get_suptitle() == "advertiser: Disagreement-UCB, end of training, seed 2"
    titles = [re.sub(r" \(.*", "", axes.get_title("left") or axes.get_title()) for axes in mean.axes]
    rewards = ["True reward", "Ridge reward", "Linear reward", "Mixed reward"]
    assert [title for title in titles if title] == [*rewards, "Weight of ridge"]
    with pytest.raises(UserError, match=r"diagnostics_seed=9 is not among the finished seeds of Disagreement"):
        recovered_maps(runs, seed=9)
    assert recovered_maps(load_runs(output, "advertiser", methods=["block"])) is None


def test_large_tables_are_not_drawn(write_run: WriteRun, tmp_path: Path):
    arrays = recovery_arrays(np.random.default_rng(0), states=40, actions=8)
    write_run("disagreement", 0, {"regret/cumulative": -3.0}, recovery=arrays)
    assert recovered_maps(load_runs(tmp_path / "outputs", "advertiser")) is None


@pytest.mark.usefixtures("no_figures")
def test_a_report_on_some_runs_does_not_replace_that_on_all(output: Path):
    whole = compare(output, "advertiser")
    before = [path.read_bytes() for path in whole.files]
    some = compare(output, "advertiser", methods=["reference", "block"], seed=1, where={"trainer.steps": 14000})
    assert some.folder.name == "advertiser-method=reference,block-trainer.steps=14000-seed=1"
    assert compare(output, "advertiser", best=1).folder.name == "advertiser-best=1"
    assert [path.read_bytes() for path in whole.files] == before
    # how the same runs are shown is no choice of runs
    shown = compare(output, "advertiser", reference="block", sort="regret/cumulative", trapped_above=100)
    assert shown.folder == whole.folder


@pytest.mark.usefixtures("no_figures")
def test_a_report_goes_where_it_is_told(output: Path, tmp_path: Path):
    folder = tmp_path / "paper" / "figures"
    assert main([f"output={output}", f"report={folder}", "tracking=none"]) == 0
    assert {path.name for path in folder.iterdir()} == {"table.md", "table.csv", "table.tex", "runs.csv"}
    assert main([f"output={output}", f"report={folder}", "method=block", "tracking=none"]) == 0
    assert "Ridge" not in (folder / "table.md").read_text(encoding="utf-8")
    assert not (output / "reports").exists()


@pytest.mark.usefixtures("no_figures")
def test_a_report_is_never_written_over_other_files(output: Path, tmp_path: Path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "maps_of_italy.svg").write_text("mine", encoding="utf-8")
    with pytest.raises(UserError, match="has files that are no report's; name a new or an empty folder"):
        compare(output, "advertiser", report=folder)
    assert [path.name for path in folder.iterdir()] == ["maps_of_italy.svg"]
    with pytest.raises(UserError, match=r"maps_of_italy\.svg is a file; name a folder"):
        compare(output, "advertiser", report=folder / "maps_of_italy.svg")


def test_a_word_that_is_given_twice_is_an_error(output: Path):
    with pytest.raises(UserError, match=r"seed is given twice \('seed=1' and 'seed=2'\)"):
        main([f"output={output}", "seed=1", "seed=2"])
    with pytest.raises(UserError, match=r"trainer\.steps is given twice"):
        main([f"output={output}", "trainer.steps=1", "trainer.steps=2"])


def test_figures_that_are_no_longer_drawn_do_not_stay(tmp_path: Path):
    old = tmp_path / "diagnostics.svg"
    old.touch()
    assert save(None, tmp_path, "diagnostics") == []
    assert not old.exists()


def test_scores_around_zero_and_far_apart_can_be_drawn(write_run: WriteRun, tmp_path: Path):
    for seed in range(4):
        write_run("oracle", seed, {"regret/cumulative": 20.0 + seed if seed else -5.0})
        write_run("block", seed, {"regret/cumulative": 2000.0})
    runs = load_runs(tmp_path / "outputs", "advertiser")
    axes = distribution_figure([summarise(runs)]).axes[0]
    assert axes.get_xscale() == "symlog"
    assert axes.get_xticks().tolist() == [-5, 0, 5, 10, 20, 50, 100, 200, 500, 1000, 2000]


def test_colours_are_fixed_and_apart():
    chosen = colours(["reference", "b_new", "a_new"])
    assert chosen == {"reference": COLOURS["reference"], "a_new": SPARE[0], "b_new": SPARE[1]}
    assert len({*COLOURS.values(), *SPARE}) == len(COLOURS) + len(SPARE)


@pytest.mark.usefixtures("no_figures")
def test_command_prints_tables_sentences_and_files(output: Path, capsys: pytest.CaptureFixture[str]):
    assert main([f"output={output}", "method=reference,disagreement", "tracking=none"]) == 0
    text = capsys.readouterr().out
    assert "Disagreement-UCB" in text
    assert "Block-UCB" not in text
    assert "the interval excludes zero" in " ".join(text.split())
    assert str(output / "reports" / "advertiser") in text
    assert "MLflow" not in text


def test_command_line_problems_are_reported_together():
    with pytest.raises(UserError, match=r"(?s)did you mean 'method'.*replicas=0: expected a whole number, 1") as caught:
        main(["metod=block", "replicas=0", "tracking=maybe", "seed"])
    assert "tracking=maybe: expected mlflow or none" in str(caught.value)
    assert "'seed' is not of the form KEY=VALUE" in str(caught.value)


def test_help_names_every_key_without_loading_pandas():
    code = "import sys; from credit.cli.compare import main; main(['--help']); sys.exit('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for key in (
        "experiment",
        "method",
        "slug",
        "variant",
        "sort",
        "best",
        "report",
        "feedback",
        "env.KEY",
        "commit",
        "seed",
        "replicas",
        "reference",
        "videos",
        "output",
        "tracking",
    ):
        assert f"  {key}=" in done.stdout


def test_nothing_finished_leaves_no_folder(tmp_path: Path):
    with pytest.raises(UserError, match="credit train -m"):
        main([f"output={tmp_path / 'none'}"])
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("no_figures")
def test_the_command_logs_what_it_reports(
    output: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    calls = []
    monkeypatch.setattr(
        "credit.tracking.report_run.log_beside_runs", lambda *args: calls.append(args) or "Logged to MLflow"
    )
    assert main([f"output={output}"]) == 0
    ((*where, metrics),) = calls
    assert where == [output, "advertiser", output / "reports" / "advertiser"]
    assert set(metrics) == {"best", "rows", "runs"}, "each number is a column of MLflow's table"
    assert metrics["best"] == 81.5, "the mean of disagreement, the lowest"
    assert capsys.readouterr().out.endswith("Logged to MLflow\n")

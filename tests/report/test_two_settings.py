"""Episodic runs in two settings: one sweep, one comparison, and no number of one beside a number of the other."""

import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from credit.cli.compare import main
from credit.report.compare import compare
from credit.report.comparison import Comparison, metrics_of, summarise
from credit.report.distribution import distribution_figure
from credit.report.figures import curves_figure
from credit.report.published import load_paper
from credit.report.runs import load_runs
from credit.report.tables import csv, latex, markdown, runs_csv
from credit.report.terminal import terminal_tables
from credit.report.text import caption, sentences

from .conftest import BLOCK_SUM, TERMINAL, WriteRun, recovery_arrays

# The share of random's regret; random itself has 1000 in one setting and 200 in the other.
SHARES = {
    "block_sum": {"random": 1.0, "reference": 0.5, "disagreement": 0.3},
    "terminal": {"random": 1.0, "reference": 0.6, "disagreement": 0.8, "oracle": 0.4},
}


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    for setting, shares in SHARES.items():
        top, feedback = (1000, BLOCK_SUM) if setting == "block_sum" else (200, TERMINAL)
        for method, share in shares.items():
            for seed in range(4):
                own = share + (0 if method == "random" else 0.01 * (seed % 2) - 0.002 * seed)
                own += 0.001 * (-1) ** seed if method in ("disagreement", "oracle") else 0
                mse = None if method == "random" else 0.2
                metrics = {"regret/cumulative": top * own, "regret/share": own, "return/policy": -own}
                metrics |= {"regret/auc": 1.0, "reward/mse": mse}
                slug = "default" if setting == "block_sum" else "feedback=terminal"
                write_run(method, seed, metrics, experiment="sepsis", slug=slug, feedback=feedback)
    return tmp_path / "outputs"


@pytest.fixture
def comparisons(output: Path) -> list[Comparison]:
    return [summarise(part) for part in load_runs(output, "sepsis").by_setting()]


def test_each_setting_has_its_own_contrasts(comparisons: list[Comparison]):
    block, terminal = (part.table.set_index("method") for part in comparisons)
    assert "oracle" not in block.index
    # offsets that a seed gives to all methods cancel in the pairs
    assert block.loc["disagreement", "difference"] == pytest.approx(0.3 - 0.5)
    assert terminal.loc["disagreement", "difference"] == pytest.approx(0.8 - 0.6)
    assert block.loc["disagreement", "improvement"] == 1.0
    assert terminal.loc["disagreement", "improvement"] == 0.0
    assert set(terminal["name"]) == {"random", "Ridge-UCB", "Disagreement-UCB", "oracle"}


def test_episodes_are_compared_by_the_share_of_randoms_regret(comparisons: list[Comparison]):
    for comparison in comparisons:
        assert [measure.metric for measure in comparison.measures] == [
            *("regret/share", "regret/cumulative", "return/policy", "reward/mse")
        ]
        assert [measure.metric for measure in comparison.curves] == ["regret/cumulative"]
        assert not comparison.counts_trapped
    assert "rapped" not in markdown(*comparisons)


def test_sentences_speak_of_their_setting_only(comparisons: list[Comparison]):
    block, terminal = ("\n".join(sentences(part)) for part in comparisons)
    assert re.search(r"lower than that of Ridge-UCB, the interval excludes zero: Disagreement-UCB −0\.2", block)
    assert re.search(r"lower than .*: oracle −0\.2.*\n.*higher than .*: Disagreement-UCB \+0\.2", terminal)
    assert "oracle" not in block


def test_markdown_has_a_section_a_setting(comparisons: list[Comparison]):
    text = markdown(*comparisons)
    assert re.findall(r"^#+ .*", text, re.MULTILINE) == [
        "# Comparison: sepsis",
        "## `feedback=block_sum`",
        "### Mean ± standard error",
        "### Share of random's regret [95% interval]",
        "## `feedback=terminal`",
        "### Mean ± standard error",
        "### Share of random's regret [95% interval]",
    ]
    assert text.count("IQM is the interquartile mean") == 1


def test_raw_numbers_name_their_setting(comparisons: list[Comparison]):
    table = pd.read_csv(io.StringIO(csv(*comparisons)))
    assert table[["setting", "method"]].to_numpy().tolist() == [
        *(["block_sum", method] for method in ("reference", "disagreement", "random")),
        *(["terminal", method] for method in ("reference", "disagreement", "oracle", "random")),
    ]
    runs = pd.read_csv(io.StringIO(runs_csv(*comparisons)))
    assert list(runs)[:4] == ["setting", "method", "slug", "seed"]
    assert runs["setting"].value_counts().to_dict() == {"block_sum": 12, "terminal": 16}
    assert set(runs["slug"]) == {"default"}


def test_latex_has_a_table_a_setting(comparisons: list[Comparison]):
    text = latex(*comparisons)
    assert text.count("\\begin{table}") == text.count("\\end{table}") == 2
    assert text.count("booktabs") == 1
    assert "\\caption{Methods on sepsis, feedback=block\\_sum: " in text


@pytest.mark.parametrize("width", [80, 100])
def test_the_command_prints_one_setting_after_the_other(
    output: Path, comparisons: list[Comparison], width: int, monkeypatch: pytest.MonkeyPatch
):
    screen = Console(width=width, file=io.StringIO(), force_terminal=True, color_system=None)
    monkeypatch.setattr("rich.console.Console", lambda **_: screen)
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    assert main([f"output={output}", "experiment=sepsis", "tracking=none"]) == 0
    lines = screen.file.getvalue().splitlines()  # type: ignore[attr-defined]
    places = {
        name: lines.index(next(line for line in lines if line.startswith(f"feedback={name} "))) for name in SHARES
    }
    assert places["block_sum"] < places["terminal"]
    upper, lower = lines[: places["terminal"]], lines[places["terminal"] :]
    assert not any("oracle" in line for line in upper)
    assert any(line.startswith("oracle") for line in lower)
    # paths are the only lines that may be wider
    assert max(len(line) for line in lines if str(output) not in line) <= width
    assert "…" not in "".join(lines)
    assert all(len(terminal_tables(part, width)) <= 4 for part in comparisons)


def test_a_setting_can_be_chosen(output: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    assert main([f"output={output}", "experiment=sepsis", "feedback=terminal", "tracking=none"]) == 0
    text = capsys.readouterr().out
    assert "feedback=terminal" in text
    assert "block_sum" not in text


def test_metrics_name_the_setting_where_there_are_several(comparisons: list[Comparison]):
    flat = metrics_of(comparisons)
    assert flat["block_sum/reference/regret/cumulative/mean"] == pytest.approx(502.0)
    assert flat["terminal/reference/regret/share/mean"] == pytest.approx(0.602)
    assert len(flat) == sum(len(part.metrics) for part in comparisons)
    assert metrics_of(comparisons[1:]) == comparisons[1].metrics


def test_a_report_has_the_metrics_of_both_settings(output: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    assert {name.split("/")[0] for name in compare(output, "sepsis").metrics} == {"block_sum", "terminal"}


def test_figures_have_a_panel_a_setting(comparisons: list[Comparison]):
    curves, scores = curves_figure(comparisons), distribution_figure(comparisons)
    assert curves is not None
    for figure in (curves, scores):
        assert [axes.get_title() for axes in figure.axes] == ["feedback=block_sum", "feedback=terminal"]
    assert [axes.get_ylabel() for axes in curves.axes] == ["Cumulative regret"] * 2
    assert [len(axes.lines) for axes in curves.axes] == [3, 4]
    # a method has one colour and one row in both
    colours = [{text.get_text(): text.get_color() for text in axes.texts} for axes in curves.axes]
    assert colours[0].items() <= colours[1].items()
    assert [text.get_text() for text in scores.axes[0].get_yticklabels()] == [
        *("Ridge-UCB", "Disagreement-UCB", "oracle", "random")
    ]
    rows = [{line.get_ydata()[0] for line in axes.lines} for axes in scores.axes]
    assert rows == [{0, 1, 3}, {0, 1, 2, 3}]
    # random is the roof
    tops = [max(line.get_ydata()[-1] for line in axes.lines) for axes in curves.axes]
    assert tops == pytest.approx([1000.0, 200.0])
    assert [axes.get_ylim()[1] for axes in curves.axes] == pytest.approx([1040.0, 208.0])


@pytest.mark.thorough
def test_maps_of_both_settings_replace_older_ones(write_run: WriteRun, output: Path, tmp_path: Path):
    folder = output / "reports" / "sepsis"
    folder.mkdir(parents=True)
    for name in ("diagnostics", "maps_other"):
        (folder / f"{name}.png").touch()
        (folder / f"{name}.svg").touch()
    large = recovery_arrays(np.random.default_rng(0), states=40, actions=8)
    place = np.indices((40, 8))
    large |= {"visits": place[0], "axis/ward": place[0] % 3, "axis/dose": place[1]}
    write_run("new", 0, {"regret/share": 0.1}, experiment="sepsis", recovery=large)
    small = recovery_arrays(np.random.default_rng(0))
    write_run("new", 0, {"regret/share": 0.1}, experiment="sepsis", slug="x=1", recovery=small, feedback=TERMINAL)
    report = compare(output, "sepsis")
    names = {path.stem for path in report.files if path.suffix == ".svg"}
    assert names == {"curves", "distribution", "maps_block_sum", "diagnostics_terminal"}
    assert {path.stem for path in folder.glob("*.svg")} == names


def test_the_papers_numbers_belong_to_its_own_setting(write_run: WriteRun, tmp_path: Path):
    for slug, feedback in {"default": BLOCK_SUM, "tuned.noise=0": {**BLOCK_SUM, "noise": 0.0}}.items():
        write_run("reference", 0, {"regret/cumulative": 1.0}, slug=slug, feedback=feedback)
    parts = load_runs(tmp_path / "outputs", "advertiser").by_setting()
    quiet, usual = [summarise(part, paper=load_paper("advertiser")) for part in parts]
    assert (quiet.paper, quiet.runs.setting.name) == (None, "block_sum-noise=0.0")
    assert "regret/cumulative/paper_mean" in usual.table
    assert "regret/cumulative/paper_mean" not in quiet.table
    assert caption(quiet, usual).count("from the paper's Table 1") == 1

"""Runs of other problems and budgets: each has a table of its own, and nothing is taken across."""

import re
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from credit.cli.compare import main
from credit.report.compare import compare
from credit.report.comparison import Comparison, summarise
from credit.report.figures import curves_figure
from credit.report.runs import load_runs
from credit.report.tables import latex, markdown
from credit.report.text import in_common, sentences

from .conftest import ENV, TRAINER, WriteRun
from .mazes import journal, write_maze_run

SHORT = {**TRAINER, "steps": 700}


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    """Long runs of two methods, short ones of one, and one in another environment: all with the same seeds."""
    for seed in range(4):
        write_run("reference", seed, {"regret/cumulative": 90.0 + seed})
        write_run("disagreement", seed, {"regret/cumulative": 80.0 + seed**2})
        write_run("disagreement", seed, {"regret/cumulative": 9.0}, slug="trainer.steps=700", trainer=SHORT)
        other = {**ENV, "states": 20}
        write_run("disagreement", seed, {"regret/cumulative": 500.0}, slug="env.states=20,mixer.alpha=1.0", env=other)
    return tmp_path / "outputs"


@pytest.fixture
def comparisons(output: Path) -> list[Comparison]:
    return [summarise(part) for part in load_runs(output, "advertiser").by_setting()]


def differences(parts: list[Comparison]) -> Iterator[tuple[str, str, float]]:
    for part in parts:
        for row in part.rows:
            if pd.notna(row.get("difference")):
                yield part.runs.setting.name, row["slug"], row["difference"]


def test_differences_are_taken_within_one_setting(comparisons: list[Comparison]):
    names = [part.runs.setting.name for part in comparisons]
    assert names == [
        "block_sum-states=10-steps=14000",
        "block_sum-states=10-steps=700",
        "block_sum-states=20-steps=14000",
    ]
    assert list(differences(comparisons)) == [(names[0], "default", pytest.approx(3.5 - 1.5 - 10.0))]
    assert [list(part.table["slug"]) for part in comparisons] == [
        ["default", "default"],
        ["default"],
        ["mixer.alpha=1.0"],
    ]
    for part in comparisons[1:]:
        assert "No run of the reference method is among these: no differences are shown." in sentences(part)


def test_runs_of_several_settings_cannot_be_summarised_together(output: Path):
    with pytest.raises(ValueError, match="several settings"):
        summarise(load_runs(output, "advertiser"))


def test_a_table_says_what_is_common_and_what_differs(comparisons: list[Comparison]):
    common = in_common(*comparisons)
    assert common.startswith("In common: env=advertiser (convexity=0.12, ")
    assert "feedback=block_sum (noise=0.2, window=7)." in common
    assert "log_every" not in common
    assert "states" not in common
    assert sentences(comparisons[2])[0] == "Here: env.states=20; trainer.steps=14000."
    text = markdown(*comparisons)
    assert common in text
    assert "## `feedback=block_sum env.states=10 trainer.steps=700`" in text
    assert f"% {common}" in latex(*comparisons)
    assert "% Here: env.states=20; trainer.steps=14000." in latex(*comparisons)


def test_curves_of_other_lengths_have_panels_of_their_own(comparisons: list[Comparison]):
    figure = curves_figure(comparisons)
    assert figure is not None
    assert [len(axes.lines) for axes in figure.axes if axes.get_visible()] == [2, 1, 1]


def test_settings_are_chosen_by_the_words_of_a_run(
    output: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    words = [f"output={output}", "tracking=none"]
    assert main([*words, "trainer.steps=700"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "feedback=block_sum env.states=10 trainer.steps=700" in text
    assert "In common: env=advertiser (" in text
    assert "Ridge-UCB" not in text
    assert main([*words, "env.interaction=[0.0,0.02,0.05]", "env.states=20"]) == 0
    assert "mixer.alpha=1.0" in capsys.readouterr().out


@pytest.mark.thorough
def test_another_maze_is_another_setting(tmp_path: Path):
    large = {"maze": "Large", "goal": [7, 10]}
    for seed in range(3):
        write_maze_run(tmp_path, "reference", seed, [0.5, 0.9])
        slug = "env.goal=7,10,env.maze=Large"
        write_maze_run(tmp_path, "disagreement", seed, [0.1, 0.2], slug=slug, env=large, tracks=journal())
        write_maze_run(tmp_path, "disagreement", seed, [0.1, 0.2], slug="env.successes=1", env={"successes": 1})
    report = compare(tmp_path, "pointmaze", videos=False)
    assert [part.runs.setting.words for part in report.comparisons] == [
        "feedback=terminal env.goal=[6,6] env.maze=Medium env.successes=1",
        "feedback=terminal env.goal=[6,6] env.maze=Medium env.successes=10",
        "feedback=terminal env.goal=[7,10] env.maze=Large env.successes=10",
    ]
    assert not list(differences(list(report.comparisons)))
    names = {path.name for path in report.files}
    assert "trajectories_terminal-goal=7,10-maze=Large-successes=10_disagreement.png" in names


def test_methods_without_a_common_seed_are_said_to_be_unpaired(write_run: WriteRun, tmp_path: Path):
    for seed in range(4):
        write_run("reference", seed, {"regret/cumulative": 90.0 + seed})
        write_run("disagreement", 10 + seed, {"regret/cumulative": 80.0 + seed**2})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    said = (
        "No seed is common to Ridge-UCB and Disagreement-UCB: nothing is paired, and P(improvement) takes their seeds "
    )
    assert f"{said}as independent." in sentences(comparison)
    assert re.search(r"\| Disagreement-UCB \| [^|]*\| 0 of 4 \| – \| 0 \| 1\.00 \|", markdown(comparison))

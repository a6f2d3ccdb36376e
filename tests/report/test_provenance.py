"""Runs of different code: said where they stand in one table, and chosen among by their commits."""

from pathlib import Path

import pytest

from credit.cli.compare import main
from credit.core.errors import UserError
from credit.report.comparison import Comparison, summarise
from credit.report.provenance import differing_code
from credit.report.runs import load_runs
from credit.report.tables import latex, markdown, runs_csv
from credit.report.text import sentences

from .conftest import TERMINAL, WriteRun

REGRET = {"regret/cumulative": 1.0}
OLD, NEW = "a1b2c3" + "0" * 34, "a1b2ff" + "1" * 34


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    for seed in range(3):
        write_run("reference", seed, REGRET, commit=OLD, version="0.1.0")
        write_run("disagreement", seed, REGRET, commit=NEW if seed else OLD, version="0.2.0" if seed else "0.1.0")
        write_run("reference", seed, REGRET, slug="feedback=terminal", feedback=TERMINAL, commit=NEW, version="0.2.0")
    return tmp_path / "outputs"


def comparisons(output: Path, *commits: str) -> list[Comparison]:
    return [summarise(part) for part in load_runs(output, "advertiser", commits=commits).by_setting()]


def test_runs_of_different_code_in_one_table_are_said(output: Path):
    block, terminal = comparisons(output)
    (said,) = [line for line in sentences(block) if "different code" in line]
    assert "version 0.1.0, commit a1b2c30000 (runs of Disagreement-UCB 1, Ridge-UCB 3)" in said
    assert "version 0.2.0, commit a1b2ff1111 (runs of Disagreement-UCB 2)" in said
    assert "`commit=…`" in said
    assert not any("different code" in line for line in sentences(terminal))
    assert markdown(block, terminal).count("different code") == 1
    assert latex(block, terminal).count("% These runs were made by different code") == 1
    assert (
        runs_csv(block, terminal).splitlines()[0].startswith("setting,method,slug,seed,config_hash,git_commit,version,")
    )


def test_versions_alone_may_differ(write_run: WriteRun, tmp_path: Path):
    for seed, version in enumerate(("0.1.0", "0.2.0", None)):
        write_run("reference", seed, REGRET, commit=None, version=version)
    frame = load_runs(tmp_path / "outputs", "advertiser").frame
    assert all(f"version {version} (runs of Ridge-UCB 1)" in differing_code(frame) for version in ("0.1.0", "0.2.0"))
    assert "version unknown (runs of Ridge-UCB 1)" in differing_code(frame)
    chosen = load_runs(tmp_path / "outputs", "advertiser", commits=["0.2"]).frame
    assert chosen["seed"].tolist() == [1]


def test_a_commit_chooses(output: Path):
    (block,) = comparisons(output, "a1b2c3")
    assert block.runs.frame[["method", "seed"]].to_numpy().tolist() == [
        *(["disagreement", 0], ["reference", 0], ["reference", 1], ["reference", 2])
    ]
    assert not any("different code" in line for line in sentences(block))
    assert len(comparisons(output, "a1b2c3", "a1b2ff")) == 2


@pytest.mark.parametrize(
    ("commit", "message"),
    [
        ("dead", r"commit=dead is none of them: .* a1b2c30000 \(4 runs\), a1b2ff1111 \(5 runs\)"),
        ("a1b2", r"commit=a1b2 is short for 2 of them"),
        ("a1b2c3-dirty", r"commit=a1b2c3-dirty is none of them"),
    ],
)
def test_a_wrong_commit_names_those_that_there_are(output: Path, commit: str, message: str):
    with pytest.raises(UserError, match=message):
        main([f"output={output}", f"commit={commit}", "tracking=none"])


def test_a_changed_checkout_is_other_code(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, REGRET, commit=OLD)
    write_run("reference", 1, REGRET, commit=f"{OLD}-dirty")
    output = tmp_path / "outputs"
    assert "commit a1b2c30000-dirty (runs" in differing_code(load_runs(output, "advertiser").frame)
    for commit, seed in (("a1b2", 0), ("a1b2-dirty", 1)):
        assert load_runs(output, "advertiser", commits=[commit]).frame["seed"].tolist() == [seed]


def test_a_commit_settles_runs_of_different_configurations(write_run: WriteRun, tmp_path: Path):
    alpha = {"_target_": "credit.recovery.mixers.RelativeMSE", "alpha": 0.4}
    write_run("reference", 0, REGRET, commit=OLD, config_hash="aaaa", mixer=alpha)
    write_run("reference", 1, REGRET, commit=NEW, config_hash="bbbb")
    with pytest.raises(UserError, match=r"commit \(commit=…\)"):
        load_runs(tmp_path / "outputs", "advertiser")
    assert load_runs(tmp_path / "outputs", "advertiser", commits=["a1b2ff"]).frame["seed"].tolist() == [1]

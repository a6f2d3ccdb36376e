"""What is said where there are no runs to compare: what there is, and a command that can be pasted."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.core.errors import UserError
from credit.report.missing import Asked, nothing_found
from credit.report.runs import load_runs

from .conftest import WriteRun

REGRET = {"regret/cumulative": 10.0}


def test_nothing_at_all_says_what_to_run(tmp_path: Path):
    with pytest.raises(UserError, match=r"Found no runs at all.*credit train -m experiment=advertiser method="):
        load_runs(tmp_path / "outputs", "advertiser")


def test_an_experiment_that_is_none_is_not_advised(write_run: WriteRun, tmp_path: Path):
    write_run("delayed", 0, REGRET, experiment="CartPole-v1")
    with pytest.raises(UserError, match="no runs of it; did you mean 'CartPole-v1'") as said:
        load_runs(tmp_path / "outputs", "CartPole-v0")
    assert "credit train" not in str(said.value)


def test_nothing_finished_names_what_was_found(write_run: WriteRun, tmp_path: Path):
    write_run("block", 0, REGRET, done=False)
    write_run("delayed", 0, REGRET, experiment="sepsis")
    output = tmp_path / "outputs"
    with pytest.raises(UserError, match=r"1 unfinished run\(s\) of block"):
        load_runs(output, "advertiser")
    with pytest.raises(UserError, match="Found runs of advertiser, sepsis only"):
        load_runs(output, "pointmaze")
    with pytest.raises(UserError, match="Finished runs exist for delayed, but not with these seeds"):
        load_runs(output, "sepsis", seed=100)


def test_a_method_without_runs_is_an_error(write_run: WriteRun, tmp_path: Path):
    write_run("disagreement", 0, REGRET)
    with pytest.raises(UserError, match="did you mean 'disagreement'"):
        load_runs(tmp_path / "outputs", "advertiser", methods=["disagreement", "disagrement"])
    with pytest.raises(UserError, match="did you mean 'disagreement'"):
        load_runs(tmp_path / "outputs", "advertiser", methods=["disagrement"])


def test_a_method_that_is_none_is_not_advised(write_run: WriteRun, tmp_path: Path):
    write_run("disagreement", 0, REGRET)
    for done in (True, False):
        with pytest.raises(UserError, match=r"method=a: .*\(valid: .*disagreement") as said:
            load_runs(tmp_path / "outputs", "advertiser", methods=["a"], seed=None if done else 7)
        assert "credit train" not in str(said.value)
    with pytest.raises(UserError, match=r"method=blok: there is none of this name, did you mean 'block'") as said:
        load_runs(tmp_path / "elsewhere", "advertiser", methods=["blok"])
    assert "credit train" not in str(said.value)


def test_what_is_advised_has_the_output_and_the_seeds_that_were_asked_for(write_run: WriteRun, tmp_path: Path):
    write_run("disagreement", 0, REGRET)
    output = tmp_path / "outputs"
    for methods, advised in {None: "disagreement", ("block",): "block", ("block", "disagreement"): "block"}.items():
        with pytest.raises(UserError) as said:
            load_runs(output, "advertiser", methods=methods, seed=99, replicas=2)
        command = f"`credit train experiment=advertiser method={advised} output={output} seed=99 replicas=2`"
        assert command in str(said.value)
    with pytest.raises(UserError) as said:
        load_runs(output, "advertiser", methods=["block"])
    assert f"`credit train experiment=advertiser method=block output={output}`" in str(said.value)


def test_the_default_output_is_not_said_and_odd_ones_are_quoted() -> None:
    assert Asked(Path("outputs"), "sepsis").command(["block"]) == "credit train experiment=sepsis method=block"
    assert Asked(Path("it is"), "sepsis").command(["block"]).endswith("'output=it is'")


def test_methods_are_advised_that_the_experiment_can_have(tmp_path: Path) -> None:
    said = {name: str(nothing_found(Asked(tmp_path, name), [], [])) for name in ("advertiser", "sepsis", "nothing")}
    assert "credit train -m experiment=advertiser method=block,delayed,reference" in said["advertiser"]
    assert "credit train -m experiment=sepsis method=delayed,reference" in said["sepsis"]
    assert "credit train" not in said["nothing"]
    assert "There is no experiment of this name; (valid: advertiser" in said["nothing"]

import json
from pathlib import Path

import pytest

from credit.core.errors import UserError
from credit.report.runs import load_runs
from credit.report.settings import is_called, name_settings, variant

from .conftest import BLOCK_SUM, TERMINAL, WriteRun

REGRET = {"regret/cumulative": 1.0}


@pytest.mark.parametrize(
    ("slug", "left"),
    [
        ("default", "default"),
        ("feedback=terminal", "default"),
        ("feedback.noise=0.5,feedback=block_sum", "default"),
        ("bonus.count.scale=0.1,feedback=terminal,transition=mixture", "bonus.count.scale=0.1,transition=mixture"),
        ("env.interaction=0.0,0.02,0.05,tuned.noise=0.5,tuned.window=3", "env.interaction=0.0,0.02,0.05"),
        ("tuned.mixer_alpha=1.0", "tuned.mixer_alpha=1.0"),
        ("+feedback.extra=1,feedback=terminal,~bonus.count", "~bonus.count"),
        ("env.feedback=1,feedbacks=2", "env.feedback=1,feedbacks=2"),
    ],
)
def test_a_variant_leaves_out_what_makes_the_setting(slug: str, left: str):
    assert variant(slug) == left


def test_settings_have_the_shortest_name_that_tells_them_apart():
    quiet, other = json.dumps({**BLOCK_SUM, "noise": 0.0}), json.dumps({**BLOCK_SUM, "window": 3})
    usual, terminal = json.dumps(BLOCK_SUM), json.dumps(TERMINAL)
    assert name_settings([terminal, usual]) == {usual: "block_sum", terminal: "terminal"}
    assert list(name_settings([terminal, usual])) == [usual, terminal]
    assert name_settings([usual, quiet, terminal]) == {
        quiet: "block_sum-noise=0.0",
        usual: "block_sum-noise=0.2",
        terminal: "terminal",
    }
    assert name_settings([usual, quiet, other])[other] == "block_sum-window=3-noise=0.2"


def test_names_can_be_file_names():
    (name,) = name_settings([json.dumps({"_target_": "their.HTTPOutcome"})]).values()
    assert name == "httpoutcome"
    odd = [json.dumps({"_target_": "my.Rule", "path": path}) for path in ("a/b c", "d")]
    assert list(name_settings(odd).values()) == ["rule-path=a-b-c", "rule-path=d"]


def test_a_setting_goes_by_its_name_and_that_of_its_rule():
    assert is_called("block_sum-noise=0.2", "block_sum")
    assert is_called("block_sum-noise=0.2", "block_sum-noise=0.2")
    assert not is_called("block_sum-noise=0.2", "block")


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    for seed in range(3):
        write_run("reference", seed, REGRET)
        write_run("reference", seed, REGRET, slug="feedback=terminal", feedback=TERMINAL)
        write_run("oracle", seed, REGRET, slug="bonus.x=1,feedback=terminal", feedback=TERMINAL)
    return tmp_path / "outputs"


def test_runs_are_split_by_their_feedback(output: Path):
    block, terminal = load_runs(output, "advertiser").by_setting()
    assert (block.setting, terminal.setting) == ("block_sum", "terminal")
    assert block.frame[["method", "slug"]].drop_duplicates().to_numpy().tolist() == [["reference", "default"]]
    assert terminal.frame[["method", "slug"]].drop_duplicates().to_numpy().tolist() == [
        ["oracle", "bonus.x=1"],
        ["reference", "default"],
    ]
    assert terminal.frame["seed"].tolist() == [0, 1, 2, 0, 1, 2]


def test_one_setting_has_a_name_only_where_it_was_chosen(output: Path):
    (block,) = load_runs(output, "advertiser", slugs=["default"], methods=["reference"]).by_setting(["block_sum"])
    assert block.setting == "block_sum"
    (terminal,) = load_runs(output, "advertiser", methods=["oracle"]).by_setting()
    assert terminal.setting == "terminal"  # by its overrides
    for folder in (output / "advertiser").glob("*/*feedback=terminal"):
        folder.rename(output / folder.parent.name)
    (alone,) = load_runs(output, "advertiser").by_setting()
    assert alone.setting == ""


def test_settings_that_have_no_runs_are_named_with_those_that_have(output: Path):
    with pytest.raises(UserError, match=r"has feedback=termnal; did you mean 'terminal'\? \(valid: block_sum, termin"):
        load_runs(output, "advertiser").by_setting(["block_sum", "termnal"])


def test_slugs_can_be_chosen_without_the_feedback(output: Path):
    for slug in ("bonus.x=1", "bonus.x=1,feedback=terminal"):
        assert set(load_runs(output, "advertiser", slugs=[slug]).frame["method"]) == {"oracle"}
    assert len(load_runs(output, "advertiser", slugs=["default"]).frame) == 6


def test_an_override_that_repeats_the_default_is_the_same_run(write_run: WriteRun, output: Path):
    for seed in (2, 3):
        write_run("reference", seed, REGRET, slug="feedback=block_sum", config_hash="hash-of-reference-default")
    block, _ = load_runs(output, "advertiser").by_setting()
    assert block.frame["seed"].tolist() == [0, 1, 2, 3]
    assert len(block.frame["folder"].unique()) == 4


def test_unfinished_runs_are_counted_in_their_setting(write_run: WriteRun, output: Path):
    unfinished = write_run("delayed", 0, REGRET, slug="feedback=terminal", feedback=TERMINAL, done=False)
    new = write_run("delayed", 1, REGRET, slug="feedback.window=2", feedback={**TERMINAL, "window": 2}, done=False)
    damaged = write_run("delayed", 2, REGRET, done=False)
    (damaged / "config.yaml").write_text("", encoding="utf-8")
    block, terminal = load_runs(output, "advertiser").by_setting()
    assert terminal.unfinished == (unfinished,)
    assert set(block.unfinished) == {new, damaged}


@pytest.mark.parametrize("text", ["{", "", "feedback: [", "env: {}"])
def test_a_run_without_its_configuration_is_named(output: Path, text: str):
    (output / "advertiser/oracle/bonus.x=1,feedback=terminal/seed-0/config.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its config\.yaml cannot be used"):
        load_runs(output, "advertiser")

"""Variants by name: one that is asked for is the one that is reported, or none."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.cli.compare import main
from credit.core.errors import UserError
from credit.report.runs import load_runs
from credit.report.variants import choose_variants, overrides

from .conftest import TRAINER, WriteRun

KNOWN = ("default", "a=1", "a=2", "b=2", "a=1,b=2", "ties_random", "c=3,env.goal=7,10", "x.y=0.1,z=2")


@pytest.mark.parametrize(
    ("typed", "chosen"),
    [
        ("a=1", {"a=1"}),
        ("a=1,b=2", {"a=1,b=2"}),
        ("b=2,a=1", {"a=1,b=2"}),
        ("z=2,x.y=.1", {"x.y=0.1,z=2"}),
        ("z=2,x.y=1e-1", {"x.y=0.1,z=2"}),
        ("env.goal=[7,10],c=3", {"c=3,env.goal=7,10"}),
        ("default,ties_random", {"default", "ties_random"}),
        ("default,a=1,b=2,a=2", None),
        ("a=1,a=2", {"a=1", "a=2"}),  # no variant has one key twice
        ("default,a=2", {"default", "a=2"}),
        ("env.goal=7,10,c=3", {"c=3,env.goal=7,10"}),
    ],
)
def test_a_text_is_a_name_first_and_a_list_else(typed: str, chosen: set[str] | None) -> None:
    if chosen is None:  # may be read in two ways
        with pytest.raises(UserError, match=r"if it is a list, write variant=default variant=a=1 variant=b=2"):
            choose_variants([typed], KNOWN, "mine")
    else:
        assert choose_variants([typed], KNOWN, "mine") == chosen


@pytest.mark.parametrize("typed", ["a=2,b=2", "b=2,a=2"])
def test_two_known_names_are_not_taken_for_one_that_is_not(typed: str) -> None:
    with pytest.raises(UserError, match=r"has no runs of a variant of this name; if it is a list, write variant="):
        choose_variants([typed], KNOWN, "mine")


def test_an_unknown_name_is_answered_by_the_nearest() -> None:
    with pytest.raises(UserError, match=r"no runs of a variant 'tie_random'; did you mean 'ties_random'\? \(valid: .*"):
        choose_variants(["default,tie_random"], KNOWN, "mine")
    with pytest.raises(UserError, match=r"no runs of a variant 'a=1,c=2'; did you mean 'a=1,b=2'"):
        choose_variants(["a=1,c=2"], KNOWN, "mine")
    with pytest.raises(UserError, match=r" and 3 more\)"):
        choose_variants(["nothing"], KNOWN, "mine")


def test_overrides_of_a_slug() -> None:
    assert overrides("default") == []
    assert overrides("env.goal=7,10,c=3,~bonus.count") == ["env.goal=7,10", "c=3", "~bonus.count"]


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    """A variant at the usual length, the same and the default one at another."""
    short = {"trainer.steps=700": 7.0, "mixer.alpha=0.1,trainer.steps=700": 8.0}
    for slug, regret in {"mixer.alpha=0.1": 900.0, **short}.items():
        trainer = {**TRAINER, "steps": 700} if slug in short else TRAINER
        write_run("disagreement", 0, {"regret/cumulative": regret}, slug=slug, trainer=trainer)
    return tmp_path / "outputs"


@pytest.mark.parametrize("key", ["slug", "variant"])
def test_a_name_with_commas_reports_exactly_that_variant(
    output: Path, key: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})
    assert main([f"output={output}", "tracking=none", f"{key}=mixer.alpha=0.1,trainer.steps=700"]) == 0
    text = capsys.readouterr().out
    assert " 8.0" in text
    assert "900" not in text
    assert " 7.0" not in text


def test_several_variants_are_named_one_by_one(output: Path) -> None:
    runs = load_runs(output, "advertiser", slugs=["trainer.steps=700", "mixer.alpha=0.1,trainer.steps=700"])
    assert sorted(runs.frame["regret/cumulative"]) == [7.0, 8.0]
    assert len(load_runs(output, "advertiser", slugs=["mixer.alpha=0.1"]).frame) == 2  # at both lengths


def test_a_variant_of_another_method_is_unknown_to_one_that_lacks_it(write_run: WriteRun, output: Path) -> None:
    write_run("block", 0, {"regret/cumulative": 1.0})
    with pytest.raises(UserError, match=r"variant=mixer.alpha=0.1: .* \(valid: default\)"):
        load_runs(output, "advertiser", methods=["block"], slugs=["mixer.alpha=0.1"])

"""Which row the others are compared to, in which order rows stand, and how many."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from credit.cli.compare import main
from credit.core.errors import UserError
from credit.report.compare import compare
from credit.report.comparison import Comparison, summarise
from credit.report.runs import load_runs
from credit.report.tables import markdown
from credit.report.text import sentences

from .conftest import TRAINER, WriteRun

SHORT = {**TRAINER, "steps": 700}


@pytest.fixture(autouse=True)
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes most of the time of a comparison."""
    monkeypatch.setattr("credit.report.compare._figures", lambda *_: {})


def fill(write_run: WriteRun, runs: dict[tuple[str, str], float], seeds: int = 3, **more: object) -> None:
    for (method, slug), regret in runs.items():
        for seed in range(seeds):
            write_run(method, seed, {"regret/cumulative": regret + seed, "reward/mse": 1 / regret}, slug=slug, **more)


def compared(folder: Path, reference: str | None = None, **more: object) -> Comparison:
    return summarise(load_runs(folder / "outputs", "advertiser"), reference=reference, **more)  # type: ignore[arg-type]


ALL = {
    ("delayed", "default"): 500.0,
    ("reference", "default"): 90.0,
    ("reference", "a=1"): 70.0,
    ("disagreement", "a=1"): 80.0,
    ("disagreement", "a=1,b=2"): 60.0,
}


@pytest.mark.parametrize(
    ("name", "key"),
    [
        (None, ("reference", "default")),
        ("delayed", ("delayed", "default")),
        ("reference/a=1", ("reference", "a=1")),
        ("a=1,b=2", ("disagreement", "a=1,b=2")),
        ("b=2,a=1", ("disagreement", "a=1,b=2")),
        ("disagreement/a=1,b=2", ("disagreement", "a=1,b=2")),
    ],
)
def test_a_reference_goes_by_the_name_of_its_method_or_variant(
    write_run: WriteRun, tmp_path: Path, name: str | None, key: tuple[str, str]
) -> None:
    fill(write_run, ALL)
    found = compared(tmp_path, name)
    assert (found.reference.key, found.reference.remark) == (key, "")
    others = found.table[[not found.is_reference(row) for row in found.rows]]
    assert others["difference"].notna().all()
    regrets = [ALL[row] for row in zip(others["method"], others["slug"], strict=True)]
    assert others["difference"].tolist() == pytest.approx([regret - ALL[key] for regret in regrets])


def test_a_variant_of_several_methods_is_no_reference_by_its_name_alone(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, ALL)
    with pytest.raises(UserError, match="write reference=reference/a=1 or reference=disagreement/a=1"):
        compared(tmp_path, "a=1")


def test_a_method_without_a_default_variant_says_which_one_stands_for_it(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, {("reference", "a=1,b=2"): 70.0, ("reference", "z=1"): 80.0, ("delayed", "default"): 500.0})
    found = compared(tmp_path)
    assert found.reference.key == ("reference", "z=1")  # which is not the first by the alphabet
    assert found.reference_name == "Ridge-UCB (z=1)"
    said = "reference has no default variant here, so the others are compared to Ridge-UCB (z=1), its variant with the "
    assert f"{said}fewest overrides, and the most seeds; `reference=VARIANT` names another." in sentences(found)
    assert said in markdown(found)


def test_among_variants_that_are_alike_the_best_stands_for_the_method_and_that_is_said(
    write_run: WriteRun, tmp_path: Path
) -> None:
    fill(write_run, {("disagreement", f"a={value}"): 90.0 - value for value in (1, 2, 3)})
    write_run("disagreement", 0, {"regret/cumulative": 1.0}, slug="a=4")  # better, but of one seed
    found = compared(tmp_path)
    assert found.reference.key == ("disagreement", "a=3")
    assert "the best of the 3 variants with the fewest overrides and most seeds, which flatters it" in "\n".join(
        sentences(found)
    )


def test_the_only_variant_of_a_method_needs_no_words(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, {("reference", "a=1"): 70.0, ("delayed", "default"): 500.0})
    found = compared(tmp_path)
    assert (found.reference.key, found.reference.remark) == (("reference", "a=1"), "")


def test_without_the_reference_method_the_message_names_what_there_is(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, {("delayed", "default"): 500.0, ("disagreement", "default"): 80.0})
    said = "No run of the reference method is among these: no differences are shown; `reference=…` names one: "
    assert f"{said}delayed, disagreement." in sentences(compared(tmp_path))


def test_a_wrong_reference_ends_before_anything_is_printed_or_written(
    write_run: WriteRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(write_run, ALL)
    with pytest.raises(UserError, match=r"reference=delayd: no method or variant .* did you mean 'delayed'"):
        main([f"output={tmp_path / 'outputs'}", "reference=delayd", "tracking=none"])
    assert capsys.readouterr().out == ""
    assert not (tmp_path / "outputs" / "reports").exists()


def test_a_reference_that_one_setting_lacks_is_used_in_the_others(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, {("delayed", "default"): 500.0, ("disagreement", "default"): 80.0})
    fill(write_run, {("disagreement", "trainer.steps=700"): 8.0}, trainer=SHORT)
    long, short = compare(tmp_path / "outputs", "advertiser", reference="delayed").comparisons
    assert long.reference.key == ("delayed", "default")
    assert short.reference.key is None
    assert "No run of delayed is among these: no differences are shown." in sentences(short)


def test_rows_are_sorted_best_first_by_a_metric_in_its_direction(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, ALL)
    assert compared(tmp_path).table["regret/cumulative/mean"].tolist() == [501.0, 91.0, 71.0, 81.0, 61.0]
    by_regret = compared(tmp_path, sort="regret/cumulative").table
    assert by_regret["regret/cumulative/mean"].tolist() == [61.0, 71.0, 81.0, 91.0, 501.0]
    by_error = compared(tmp_path, sort="reward/mse").table
    assert by_error["regret/cumulative/mean"].tolist() == [501.0, 91.0, 81.0, 71.0, 61.0]
    with pytest.raises(UserError, match="sort=nothing: runs can be ranked by regret/cumulative, reward/mse"):
        compared(tmp_path, sort="nothing")


def test_higher_is_better_where_the_metric_says_so(write_run: WriteRun, tmp_path: Path) -> None:
    for seed in range(3):
        write_run("delayed", seed, {"eval/return": 1.0})
        write_run("reference", seed, {"eval/return": 3.0})
        write_run("disagreement", seed, {"eval/return": None, "return/label": 0.0})
    found = compared(tmp_path, sort="eval/return")
    assert found.table["method"].tolist() == ["reference", "delayed", "disagreement"]  # what is not known comes last


def test_the_best_are_shown_with_the_reference_and_the_rest_is_counted(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, ALL)
    found = compared(tmp_path, best=2)
    assert found.table["regret/cumulative/mean"].tolist() == [61.0, 71.0, 91.0]
    assert found.left_out == 2
    assert "Shown are the best by final regret, 2 rows are left out: " in sentences(found)[0]
    assert set(found.runs.frame["slug"]) == {"default", "a=1", "a=1,b=2"}  # and so in every figure
    assert [f"{method}/{slug}" for method, slug, _ in found.groups] == [
        *("disagreement/a=1,b=2", "reference/a=1", "reference/default")
    ]
    assert compared(tmp_path, best=9).left_out == 0


def test_few_seeds_are_said_to_be_few(write_run: WriteRun, tmp_path: Path) -> None:
    fill(write_run, {("delayed", "default"): 500.0}, seeds=4)
    fill(write_run, {("reference", "default"): 90.0}, seeds=12)
    assert "Few seeds (4): an interval from fewer than 10 is rough." in sentences(compared(tmp_path))


def test_titles_that_differ_within_a_row_are_said(write_run: WriteRun, tmp_path: Path) -> None:
    for seed, title in enumerate(("A", "B", "B")):
        file = write_run("reference", seed, {"regret/cumulative": 1.0}) / "summary.json"
        summary = json.loads(file.read_text(encoding="utf-8"))
        file.write_text(json.dumps(summary | {"paper": {"name": title}}), encoding="utf-8")
        write_run("delayed", seed, {"regret/cumulative": 2.0})
    lines = sentences(summarise(load_runs(tmp_path / "outputs", "advertiser")))
    (said,) = [line for line in lines if "several titles" in line]
    assert "reference has 'A' (seeds 0), 'B' (seeds 1, 2) and is called A" in said
    assert "delayed" not in said

import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.report.comparison import Comparison, summarise
from credit.report.published import load_paper
from credit.report.runs import load_runs
from credit.report.scale import Scale
from credit.report.statistics import Interval
from credit.report.tables import csv, latex, markdown
from credit.report.text import caption, sentences

from .conftest import WriteRun

NAN = float("nan")


@pytest.fixture
def comparison(write_run: WriteRun, tmp_path: Path) -> Comparison:
    """Ridge 100, 110, 120, 130; block far above; disagreement within reach, on other seeds too; a variant."""
    for seed, regret in enumerate((100.0, 110.0, 120.0, 130.0)):
        write_run("reference", seed, {"regret/cumulative": regret, "reward/mse": 0.002 + seed * 1e-4})
        write_run("block", seed, {"regret/cumulative": 2000.0 + seed, "reward/mse": None})
    for seed, regret in {2: 119.0, 3: 132.0, 4: 900.0}.items():
        write_run("disagreement", seed, {"regret/cumulative": regret, "reward/mse": 0.001})
    write_run("block", 0, {"regret/cumulative": 1600.0, "reward/mse": None}, slug="ties_random")
    write_run("our_own", 0, {"regret/cumulative": 50.0, "reward/mse": None}, done=False)
    runs = load_runs(tmp_path / "outputs", "advertiser")
    return summarise(runs, paper=load_paper("advertiser"))


def row(comparison: Comparison, name: str) -> pd.Series:
    return comparison.table.set_index("name").loc[name]


def test_the_papers_methods_come_first_and_in_its_order(comparison: Comparison):
    assert comparison.table["name"].tolist() == [
        "Block-UCB",
        "Block-UCB (ties_random)",
        "Ridge-UCB",
        "Disagreement-UCB",
    ]


def test_numbers_by_hand(comparison: Comparison):
    ridge, ours = row(comparison, "Ridge-UCB"), row(comparison, "Disagreement-UCB")
    assert ridge["regret/cumulative/mean"] == 115.0
    assert ridge["regret/cumulative/se"] == pytest.approx((500 / 3) ** 0.5 / 2)
    assert ridge["iqm"] == 115.0
    assert ridge["regret/cumulative/paper_mean"] == 195.42
    assert ours["trapped"] == 1
    # of 12 pairs, 2 are of the same seed; of the others 119 wins against 130, 132 and 900 win none
    assert ours["improvement"] == pytest.approx(1 / 10)


def test_differences_are_paired_on_common_seeds_only(comparison: Comparison):
    ours = row(comparison, "Disagreement-UCB")
    assert ours["difference_n"] == 2
    assert ours["difference"] == pytest.approx((-1 + 2) / 2)
    assert pd.isna(row(comparison, "Ridge-UCB")["difference"])


def test_unknown_metrics_are_left_out(comparison: Comparison):
    assert [measure.metric for measure in comparison.measures] == ["regret/cumulative", "reward/mse"]
    assert pd.isna(row(comparison, "Block-UCB")["reward/mse/mean"])
    assert "AUC" not in markdown(comparison)


def test_sentences_claim_only_what_the_intervals_show(comparison: Comparison):
    text = "\n".join(sentences(comparison))
    assert re.search(r"higher than that of Ridge-UCB, the interval excludes zero: Block-UCB \+1886\.\d", text)
    assert re.search(r"not shown to differ .*: Disagreement-UCB \+0\.5 \[.*\], n = 2\.", text)
    assert "No interval against Ridge-UCB, fewer than two common seeds: Block-UCB (ties_random)." in text
    assert "is lower" not in text
    assert "1 unfinished run was left out." in text


def test_seeds_that_all_differ_by_the_same_are_not_said_to_be_too_few(write_run: WriteRun, tmp_path: Path):
    for seed in range(2):
        same = {"eval/success": 0.0, "eval/final": 0.0, "eval/auc": 0.0}
        write_run("reference", seed, same)
        write_run("delayed", seed, same)
        write_run("block", seed, same | {"eval/auc": 0.1 + 0.1 * seed})
    write_run("disagreement", 0, same)
    said = [line for line in sentences(summarise(load_runs(tmp_path / "outputs", "advertiser"))) if "No inter" in line]
    assert said == [
        "No interval against Ridge-UCB in Success in the last four rounds, common seeds all differ by the same: "
        "Block-UCB.",
        "No interval against Ridge-UCB, common seeds all differ by the same: Delayed Q-learning.",
        "No interval against Ridge-UCB, fewer than two common seeds: Disagreement-UCB.",
    ]


def test_markdown(comparison: Comparison):
    text = markdown(comparison)
    assert "| Ridge-UCB | 0–3 (n = 4) | 115.0 ± 6.5 [195.4 ± 42.1] | 2.15 ± 0.06 [2.12 ± 0.32] |" in text
    assert "| Method | Seeds | Final regret | Mixed reward MSE (×10⁻³) |" in text
    assert "the paper's Table 1, 20 seeds" in text
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in tables[:6]} == {5}
    assert {line.count("|") for line in tables[6:]} == {7}


def test_csv_holds_the_raw_numbers(comparison: Comparison):
    table = pd.read_csv(io.StringIO(csv(comparison)))
    pd.testing.assert_frame_equal(table, comparison.table, check_dtype=False)


def test_latex_is_well_formed(comparison: Comparison):
    text = latex(comparison)
    assert text.isascii()
    assert text.count("\\begin{") == text.count("\\end{") == 3
    assert "Block-UCB (ties\\_random)" in text
    assert "$\\times$10$^{-3}$" in text
    for part in text.split("\\begin{tabular}")[1:]:
        rows = [line for line in part.splitlines() if line.startswith("{}")]
        assert len({line.count(" & ") for line in rows}) == 1
        assert all(line.endswith(" \\\\") for line in rows)
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)[%#_]", re.sub("^%.*$", "", text, flags=re.MULTILINE))


def test_without_the_reference_there_are_no_differences(write_run: WriteRun, tmp_path: Path):
    write_run("block", 0, {"regret/cumulative": 1.0})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    assert "difference" not in comparison.table
    assert "Difference" not in markdown(comparison)
    assert sentences(comparison) == ["No run of the reference method is among these: no differences are shown."]


def test_other_experiments_are_compared_by_what_they_measure(write_run: WriteRun, tmp_path: Path):
    for seed in range(3):
        write_run("reference", seed, {"eval/success": 0.5 + 0.1 * seed}, experiment="maze")
        write_run("delayed", seed, {"eval/success": 0.1 * seed}, experiment="maze")
    comparison = summarise(load_runs(tmp_path / "outputs", "maze"), paper=load_paper("maze"))
    assert comparison.primary.metric == "eval/success"
    assert "trapped" not in comparison.table
    assert row(comparison, "Delayed Q-learning")["improvement"] == 0.0
    assert "has the higher success rate" in caption(comparison)


def test_runs_without_any_measure_are_an_error(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, {"time/fit": 1.0})
    with pytest.raises(UserError, match="they have time/fit"):
        summarise(load_runs(tmp_path / "outputs", "advertiser"))


def test_a_metric_that_some_seeds_lack_is_said(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, {"regret/cumulative": 1.0, "policy/error": 0.5})
    write_run("reference", 1, {"regret/cumulative": 2.0, "policy/error": None})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    assert "Policy error of Ridge-UCB is known for 1 of 2 seeds only." in sentences(comparison)


def test_flat_metrics_name_the_method(comparison: Comparison):
    assert comparison.metrics["reference/regret/cumulative/mean"] == 115.0
    assert comparison.metrics["block/ties_random/iqm"] == 1600.0
    assert not any(value != value for value in comparison.metrics.values())


def test_scale_follows_size_and_error():
    scale = Scale.of(pd.Series([2.27e6, 1.6e5]), pd.Series([6.0e3, 2.4e4]))
    assert (scale.exponent, scale.unit, scale.number(2.27e6)) == (3, " (×10³)", "2270")
    assert Scale.of(pd.Series([0.3, 0.9]), pd.Series([0.06, 0.0])) == Scale(0, 2)
    assert Scale.of(pd.Series([0.3, 0.9]), pd.Series([0.04, 0.1])) == Scale(0, 3)
    assert Scale.of(pd.Series([5.0]), pd.Series([float("nan")])) == Scale(0, 2)
    # an error of rounding, and a zero of rounding, do not set the scale
    assert Scale.of(pd.Series([1000.0, 800.0]), pd.Series([2e-13, 1.2])) == Scale(0, 1)
    assert Scale.of(pd.Series([2e-3, 2e-30]), pd.Series([3e-4, 1e-31])) == Scale(-3, 2)
    # a mean within its error may be printed as zero
    assert Scale.of(pd.Series([-0.02, 90.0]), pd.Series([3.0, 4.0])) == Scale(0, 1)
    assert Scale(0, 1).number(-0.5) == "−0.5"
    assert Scale(0, 1).number(float("nan")) == "–"


@pytest.mark.parametrize(
    ("numbers", "printed"),
    [
        ([(3.9e-11, 7e-12), (2.99e-3, 6e-5)], ["(3.9 ± 0.7)×10⁻¹¹", "0.00299 ± 0.00006"]),
        ([(4e-4, 1e-4), (0.31, 0.02)], ["(4.0 ± 1.0)×10⁻⁴", "0.310 ± 0.020"]),
        ([(85.2, 3.1), (3.4e7, 2e6)], ["85.2 ± 3.1", "(3.40 ± 0.20)×10⁷"]),
        ([(1e-8, float("nan")), (0.5, float("nan"))], ["1.0×10⁻⁸", "0.5"]),
        ([(2e-8, 0.0), (0.5, 1e-18)], ["(2.0 ± 0.0)×10⁻⁸", "0.50000 ± 0.00000"]),
        ([(0.3, 2e-4), (0.9, 0.04)], ["0.30000 ± 0.00020", "0.900 ± 0.040"]),
    ],
)
def test_a_column_of_very_different_numbers_has_no_common_power(numbers: list[tuple[float, float]], printed: list[str]):
    scale = Scale.of(*(pd.Series(column) for column in zip(*numbers, strict=True)))
    assert (scale.wide, scale.unit) == (True, "")
    assert [scale.with_error(*pair) for pair in numbers] == printed


@pytest.mark.parametrize(
    ("numbers", "printed"),
    [
        ([(0.2, 0.03), (0.0, 0.0)], ["0.200 ± 0.030", "0 ± 0"]),
        ([(0.2, 0.03), (3e-17, 1e-17)], ["0.200 ± 0.030", "(3.0 ± 1.0)×10⁻¹⁷"]),
        ([(0.002, 3e-4), (4e-30, 0.0)], ["2.00 ± 0.30", "(4.0 ± 0.0)×10⁻²⁷"]),  # by the thousand, as the title says
        ([(0.3, NAN), (0.0, NAN), (2e-12, NAN)], ["0.300", "0", "2.0×10⁻¹²"]),
    ],
)
def test_only_what_is_zero_is_printed_as_zero(numbers: list[tuple[float, float]], printed: list[str]):
    scale = Scale.of(*(pd.Series(column) for column in zip(*numbers, strict=True)))
    assert [scale.with_error(*pair) for pair in numbers] == printed


@pytest.mark.parametrize("seed", range(20))
def test_no_printed_number_is_long_or_nothing(seed: int):
    rng = np.random.default_rng(seed)
    least, span = rng.uniform(-12, 4), rng.uniform(0, 8)
    means = pd.Series(10 ** rng.uniform(least, least + span, size=5))
    errors = means * rng.uniform(0.01, 0.3, size=5)
    scale = Scale.of(means, errors)
    for mean, error in zip(means, errors, strict=True):
        shown = scale.with_error(mean, error)
        number = shown.strip("(").partition(" ")[0]
        assert len(number) <= 8  # seven digits and a point
        assert float(number) > 0
        value = float(number) * 10**scale.exponent if not scale.wide else float(number)
        if "×" in shown:
            value *= 10.0 ** int(shown.partition("×10")[2].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
        assert value == pytest.approx(mean, abs=error / 1.9)


def test_a_wide_column_is_printed_in_every_form(write_run: WriteRun, tmp_path: Path):
    for seed in range(4):
        write_run("reference", seed, {"regret/cumulative": 90.0 + seed, "reward/mse": 3e-3 + 1e-4 * seed})
        write_run("oracle", seed, {"regret/cumulative": 60.0 + seed, "reward/mse": 3.9e-11 + 1e-12 * seed})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    assert "×10⁻¹¹ |" in markdown(comparison)
    assert "| Mixed reward MSE |" in markdown(comparison)
    assert "$\\times$10$^{-11}$" in latex(comparison)


def test_the_papers_table_is_complete():
    paper = load_paper("advertiser")
    assert paper is not None
    assert list(paper.methods) == ["block", "delayed", "reference", "adaptive_mse", "disagreement"]
    assert paper.methods["disagreement"]["reward/mse"] == (0.00149, 0.00014)
    assert "reward/mse" not in paper.methods["block"]
    assert load_paper("unknown") is None


def test_an_interval_in_a_wide_column_has_the_digits_of_its_width() -> None:
    scale = Scale.of(pd.Series([0.903, 0.78321]), pd.Series([0.024, 0.00043]))
    assert scale.wide
    assert scale.interval(Interval(0.903, 0.868, 0.95)) == ("0.903", "[0.868, 0.950]")
    assert scale.interval(Interval(0.5260, 0.5237, 0.5291)) == ("0.5260", "[0.5237, 0.5291]")
    assert scale.interval(Interval(-0.26, -0.27, -0.25), signed=True) == ("−0.260", "[−0.270, −0.250]")
    assert scale.interval(Interval(0.5, NAN, NAN)) == ("0.5", "")

"""The numbers of a maze against NumPy and against sums done by hand."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from credit.report.comparison import Comparison, summarise
from credit.report.figures import curves_figure
from credit.report.looks import APART
from credit.report.runs import load_runs
from credit.report.statistics import pooled
from credit.report.tables import csv, grids, latex, markdown
from credit.report.text import caption, sentences
from credit.runs.intervals import GAP, SHARE, mean_interval

from .mazes import write_maze_run

# success after each of six rounds; lost and learned rounds are 1 of 4, 0 of 1, 1 of 3 and 0 of 2, 0 of 1, none
OURS = [[0.1, 0.9, 0.5, 1.0, 1.0, 0.6], [0.0, 0.2, 0.4, 0.6, 0.9, 1.0], [0.3, 0.4, 0.95, 0.55, 0.9, 0.9]]
THEIRS = [[0.0, 0.1, 0.2, 0.9, 0.8, 1.0], [0.0, 0.0, 0.1, 0.3, 0.9, 0.7], [0.2, 0.2, 0.1, 0.4, 0.5, 0.85]]


@pytest.fixture
def comparison(tmp_path: Path) -> Comparison:
    for seed in range(3):
        better = [min(1.0, rate + 0.05) for rate in OURS[seed]]
        write_maze_run(tmp_path, "disagreement", 1000 + seed, OURS[seed], averaged=better)
        write_maze_run(tmp_path, "reference", 1000 + seed, THEIRS[seed])
    write_maze_run(tmp_path, "delayed", 1000, [0.0] * 6)
    return summarise(load_runs(tmp_path, "pointmaze"))


def row(comparison: Comparison, method: str) -> dict[str, float]:
    return comparison.table.set_index("method").loc[method].to_dict()


def test_columns_are_success_in_the_end_over_time_and_lost(comparison: Comparison):
    assert [measure.metric for measure in comparison.measures] == [
        *("eval/final", "eval/final_averaged", "eval/auc", "eval/auc_averaged", "eval/lost", "eval/lost_averaged")
    ]
    assert not comparison.counts_trapped
    assert "rapped" not in markdown(comparison)


@pytest.mark.parametrize(("metric", "of"), [("eval/final", slice(-4, None)), ("eval/auc", slice(None))])
def test_means_and_paired_differences(comparison: Comparison, metric: str, of: slice):
    ours, theirs = (np.mean(np.array(rates)[:, of], axis=1) for rates in (OURS, THEIRS))
    found = row(comparison, "disagreement")
    assert found[f"{metric}/mean"] == pytest.approx(ours.mean())
    assert found[f"{metric}/se"] == pytest.approx(stats.sem(ours))
    prefix = "" if metric == "eval/final" else f"{metric}/"
    mean, low, high = mean_interval(ours - theirs, GAP)
    assert found[f"{prefix}difference"] == pytest.approx(mean)
    assert found[f"{prefix}difference_low"] == pytest.approx(low)
    assert found[f"{prefix}difference_high"] == pytest.approx(high)
    assert found[f"{prefix}difference_n"] == 3
    assert np.isnan(row(comparison, "reference")[f"{prefix}difference"])


def test_higher_is_better(comparison: Comparison):
    ours, theirs = ([np.mean(rates[-4:]) for rates in every] for every in (OURS, THEIRS))
    # not those of the same seed
    wins = np.mean([a > b for i, a in enumerate(ours) for j, b in enumerate(theirs) if i != j])
    assert row(comparison, "disagreement")["improvement"] == pytest.approx(wins)
    assert "the higher success in the last four rounds of two runs with different seeds" in caption(comparison)


def test_lost_rounds_are_pooled_over_seeds(comparison: Comparison):
    ours, theirs = row(comparison, "disagreement"), row(comparison, "reference")
    assert ours["eval/lost/mean"] == pytest.approx(2 / 8)
    # 1 − 4/4, 0 − 1/4, 1 − 3/4, by the mean of 4, 1, 3
    residuals = np.array([0, -0.25, 0.25]) / (8 / 3)
    assert ours["eval/lost/se"] == pytest.approx(residuals.std(ddof=1) / 3**0.5)
    assert (theirs["eval/lost/mean"], theirs["eval/lost/se"]) == (0.0, 0.0)
    assert ours["eval/lost/difference"] == pytest.approx(0.25)
    assert ours["eval/lost/difference_high"] == pytest.approx(mean_interval(0.25 + residuals, GAP)[2])
    # .55 is .6 for the averaged actor, and .5 is .55
    assert ours["eval/lost_averaged/mean"] == pytest.approx(1 / 8)


def test_who_never_learned_has_lost_nothing_that_could_be_shared(comparison: Comparison):
    assert np.isnan(row(comparison, "delayed")["eval/lost/mean"])
    means = {cells[0][0]: cells for cells in grids(comparison)[0].rows}
    assert [cell[0].strip("0.") for cell in means["Delayed SAC"][2:]] == ["", "", "", "", "–", "–"]


def test_a_pooled_share_is_taken_over_common_seeds(tmp_path: Path):
    for seed in range(3):
        write_maze_run(tmp_path, "disagreement", seed, OURS[seed])
    for seed in (0, 1):
        write_maze_run(tmp_path, "reference", seed, THEIRS[seed])
    found = row(summarise(load_runs(tmp_path, "pointmaze")), "disagreement")
    assert found["eval/lost/mean"] == pytest.approx(2 / 8)
    assert found["eval/lost/difference"] == pytest.approx(1 / 5)
    assert found["eval/lost/difference_n"] == 2


def test_the_scores_of_a_ratio_have_its_mean_and_error():
    rng = np.random.default_rng(0)
    bases = rng.integers(5, 12, size=400).astype(float)
    amounts = rng.binomial(bases.astype(int), 0.3).astype(float)
    scores = pooled(amounts, bases)
    assert scores.mean() == pytest.approx(amounts.sum() / bases.sum())
    left_out = [(amounts.sum() - a) / (bases.sum() - b) for a, b in zip(amounts, bases, strict=True)]
    jackknife = np.sqrt(399 / 400 * np.sum((np.array(left_out) - np.mean(left_out)) ** 2))
    assert stats.sem(scores) == pytest.approx(jackknife, rel=0.01)
    assert np.isnan(pooled([0, 0], [0, 0])).all()


def test_every_table_has_its_contrasts(comparison: Comparison):
    titles = [grid.title for grid in grids(comparison)]
    assert titles[0] == "Mean ± standard error"
    assert titles[1].startswith("Success in the last four rounds")
    assert titles[2] == "Difference to DNN-SAC [95% interval]"
    assert latex(comparison).count("\\begin{tabular}") == 3
    assert "eval/auc/difference_low" in csv(comparison).splitlines()[0]
    told = "\n".join(sentences(comparison))
    assert re.search(r"AUC of success is higher than that of DNN-SAC, .*: Disagreement-SAC \+0\.\d+ \[", told)


def test_figure_4_has_a_panel_a_policy_over_trajectories(comparison: Comparison):
    figure = curves_figure([comparison])
    assert figure is not None
    assert [axes.get_title() for axes in figure.axes] == ["Current actor", "Averaged actor"]
    assert figure.get_supxlabel().startswith("Online trajectories")
    for axes, gain in zip(figure.axes, (0.0, 0.05), strict=True):
        drawn = {line.get_color(): line for line in axes.lines}
        names = {text.get_color(): text.get_text() for text in axes.texts}
        assert sorted(names.values()) == ["DNN-SAC", "Delayed SAC", "Disagreement-SAC"]
        assert axes.get_ylim() == (0, 1)  # no rate is beyond
        assert axes.spines["bottom"].get_position() == ("outward", APART)  # a curve at 0 does not lie on the axis
        assert not any(line.get_clip_on() for line in axes.lines)
        for colour, name in names.items():
            values = {"DNN-SAC": THEIRS, "Disagreement-SAC": OURS, "Delayed SAC": [[0.0] * 6]}[name]
            expected = np.minimum(1.0, np.array(values) + (gain if values is OURS else 0.0))
            assert drawn[colour].get_xdata().tolist() == [0, 5, 10, 15, 20, 25, 30]
            assert drawn[colour].get_ydata() == pytest.approx([0.0, *expected.mean(axis=0)])
    # the band of ours after 5 trajectories
    bands = [path.vertices for part in figure.axes[0].collections for path in part.get_paths()]
    first = np.array(OURS)[:, 0]
    ends = mean_interval(first, SHARE)[1:]
    assert any(
        np.sort(np.unique(band[band[:, 0] == 5.0, 1])) == pytest.approx(ends)
        for band in bands
        if np.isfinite(band).all()
    )

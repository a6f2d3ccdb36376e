"""What figures say once, and that nothing of them is lost: long names, curves at 0, rates, several settings."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from credit.report import style
from credit.report.comparison import Comparison, summarise
from credit.report.distribution import distribution_figure
from credit.report.figures import curves_figure
from credit.report.labels import circumstances, row_names, title
from credit.report.looks import looks
from credit.report.runs import load_runs

from .conftest import TERMINAL, TRAINER, WriteRun
from .mazes import write_maze_run

SHORT = {**TRAINER, "steps": 700}
LONG = [
    f"bonus.count.scale={scale},bonus.local_mse.scale={scale},mixer.alpha={alpha},trainer.steps=700,uncertainty.draws=20"
    for scale in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    for alpha in (0.1, 0.3)
]


@pytest.fixture
def many(write_run: WriteRun, tmp_path: Path) -> Comparison:
    """Twelve variants with long names."""
    for place, slug in enumerate(LONG):
        for seed in range(3):
            write_run("disagreement", seed, {"regret/cumulative": 50.0 + place + seed}, slug=slug, trainer=SHORT)
    return summarise(*load_runs(tmp_path / "outputs", "advertiser").by_setting())


def figures(*comparisons: Comparison) -> list[Figure]:
    """Both, drawn."""
    with style.styled():
        found = [curves_figure(comparisons), distribution_figure(comparisons)]
        for figure in found:
            assert figure is not None
            FigureCanvasAgg(figure).draw()
    return [figure for figure in found if figure is not None]


def widths(figure: Figure) -> list[float]:
    """Inches of its panels."""
    return [axes.get_position().width * figure.get_figwidth() for axes in figure.axes if axes.get_visible()]


def assert_all_inside(figure: Figure) -> None:
    """Every text lies inside the picture, and no two of the names overlap."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    every = list(figure.texts)
    for axes in figure.axes:
        low, high = sorted(axes.get_ylim())
        ticks = [text for text in axes.get_yticklabels() if low <= text.get_position()[1] <= high]
        every += [*axes.texts, axes.title, axes.xaxis.label, *ticks]
    edge = figure.bbox
    for text in every:
        if text.get_text():
            box = Text.get_window_extent(text, renderer)  # without its arrow
            assert box.x0 >= edge.x0 - 1, text
            assert box.x1 <= edge.x1 + 1, text
            assert box.y0 >= edge.y0 - 1, text
            assert box.y1 <= edge.y1 + 1, text
    for axes in figure.axes:
        boxes = sorted((Text.get_window_extent(text, renderer) for text in axes.texts), key=lambda box: box.y0)
        for below, above in pairwise(boxes):
            assert below.y1 <= above.y0 + 2


def test_long_names_neither_squeeze_the_plot_nor_leave_the_picture(many: Comparison) -> None:
    for figure in figures(many):
        assert_all_inside(figure)
        assert min(widths(figure)) > 3.2


def test_names_say_what_differs_by_the_shortest_keys(many: Comparison) -> None:
    names = list(row_names([many]).values())
    # what all have is in the title; `scale` alone would be two
    assert names[0] == "Disagreement-UCB\ncount.scale=0.1,\nlocal_mse.scale=0.1, alpha=0.1"
    assert len({*names}) == 12


def test_a_title_says_the_experiment_what_is_common_and_how_many_seeds(many: Comparison) -> None:
    for figure in figures(many):
        title = " ".join(figure.get_suptitle().split())
        assert title == "advertiser, feedback=block_sum, trainer.steps=700, uncertainty.draws=20, n = 3 seeds"
        assert not any(axes.get_title() for axes in figure.axes)


def test_a_picture_of_one_method_says_its_circumstances_once(many: Comparison) -> None:
    common = "feedback=block_sum, trainer.steps=700, uncertainty.draws=20"
    assert circumstances(many.runs, "default") == f" ({common})"
    assert circumstances(many.runs, "uncertainty.draws=20") == f" ({common.rpartition(', ')[0]})"


def test_what_all_variants_of_a_method_share_is_said_once(write_run: WriteRun, tmp_path: Path) -> None:
    write_run("reference", 0, {"regret/cumulative": 50.0})
    for alpha in (0.1, 0.3):
        slug = f"mixer.alpha={alpha},uncertainty.draws=20"
        write_run("disagreement", 0, {"regret/cumulative": 50.0 + alpha}, slug=slug)
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    names = ["Ridge-UCB", "Disagreement-UCB\nalpha=0.1", "Disagreement-UCB\nalpha=0.3"]
    assert list(row_names([comparison]).values()) == names
    for figure in figures(comparison):
        title = "advertiser, n = 1 seed; Disagreement-UCB with uncertainty.draws=20"
        assert " ".join(figure.get_suptitle().split()) == title


def test_lines_of_one_method_are_told_apart(many: Comparison) -> None:
    styles = looks([many]).values()
    assert len({(look.colour, str(look.dashes)) for look in styles}) == 12
    first, *_ = styles
    assert first.colour == style.colours(["disagreement"])["disagreement"]


def test_seeds_that_differ_are_a_range(write_run: WriteRun, tmp_path: Path) -> None:
    for method, seeds in {"reference": 2, "disagreement": 4}.items():
        for seed in range(seeds):
            write_run(method, seed, {"regret/cumulative": 50.0 + seed})
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    assert [figure.get_suptitle() for figure in figures(comparison)] == ["advertiser, n = 2–4 seeds"] * 2


@pytest.fixture
def maze(tmp_path: Path) -> Comparison:
    """One method that never succeeds, two that do, nearly always."""
    for seed in range(4):
        write_maze_run(tmp_path, "delayed", seed, [0.0] * 5)
        write_maze_run(tmp_path, "reference", seed, [0.1, 0.5, 0.9, 0.95, 1.0])
        write_maze_run(tmp_path, "disagreement", seed, [0.02, 0.05, 0.9, 1.0, 0.85 + 0.05 * seed])
    return summarise(load_runs(tmp_path, "pointmaze"))


def test_a_curve_at_zero_is_seen(maze: Comparison) -> None:
    curves, _ = figures(maze)
    for axes in curves.axes:
        (flat,) = [line for line in axes.lines if not np.any(line.get_ydata())]
        below = axes.transData.transform((0, 0))[1] - axes.spines["bottom"].get_window_extent().y1
        assert below > flat.get_linewidth() * curves.dpi / 72


def test_a_curve_of_one_point_is_drawn_as_a_point(write_run: WriteRun, tmp_path: Path) -> None:
    for seed in range(3):
        write_run("reference", seed, {"regret/cumulative": 5.0 + seed}, steps=(70,))
    curves, _ = figures(summarise(load_runs(tmp_path / "outputs", "advertiser")))
    (axes,) = curves.axes
    assert any(line.get_marker() == "o" and line.get_xydata().tolist() == [[70.0, 6.0]] for line in axes.lines)


def test_bands_of_rates_and_their_axes_stay_between_0_and_1(maze: Comparison) -> None:
    curves, scores = figures(maze)
    for axes in curves.axes:
        heights = np.concatenate([path.vertices[:, 1] for part in axes.collections for path in part.get_paths()])
        assert heights.min() >= 0
        assert heights.max() <= 1
    (axes,) = scores.axes
    assert axes.get_xscale() == "linear"
    assert 0 <= axes.get_xlim()[0] < axes.get_xlim()[1] <= 1


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_the_axis_of_a_rate_that_is_the_same_everywhere_goes_from_0_to_1(tmp_path: Path, rate: float) -> None:
    for seed in range(3):
        write_maze_run(tmp_path, "delayed", seed, [rate] * 4)
    curves, scores = figures(summarise(load_runs(tmp_path, "pointmaze")))
    assert all(axes.get_ylim() == (0, 1) for axes in curves.axes)
    (axes,) = scores.axes
    assert axes.get_xlim() == (0, 1)
    assert not any(part.get_clip_on() for part in (*axes.collections, *axes.lines))  # half a point is beyond
    for figure in (curves, scores):
        assert_all_inside(figure)


def test_a_rate_that_differs_tenfold_has_a_linear_axis(tmp_path: Path) -> None:
    for method, rate in {"delayed": 0.0, "reference": 0.05, "disagreement": 0.9}.items():
        for seed in range(6):
            write_maze_run(tmp_path, method, seed, [rate] * 4)
    comparison = summarise(load_runs(tmp_path, "pointmaze", methods=["reference", "disagreement"]))
    assert distribution_figure([comparison]).axes[0].get_xscale() == "linear"
    assert distribution_figure([summarise(load_runs(tmp_path, "pointmaze"))]).axes[0].get_xscale() == "linear"


@pytest.mark.parametrize(("tops", "together"), [((100.0, 60.0), True), ((100.0, 10.0), False)])
def test_panels_share_their_axes_unless_one_would_be_squeezed(
    write_run: WriteRun, tmp_path: Path, tops: tuple[float, float], together: bool
) -> None:
    for (slug, feedback), top in zip((("default", None), ("feedback=terminal", TERMINAL)), tops, strict=True):
        for seed in range(3):
            more = {"feedback": feedback} if feedback else {}
            write_run("reference", seed, {"regret/cumulative": top + seed}, slug=slug, **more)
            write_run("disagreement", seed, {"regret/cumulative": 0.8 * top + seed}, slug=slug, **more)
    parts = [summarise(part) for part in load_runs(tmp_path / "outputs", "advertiser").by_setting()]
    curves, scores = figures(*parts)
    for limits in ([axes.get_ylim() for axes in curves.axes], [axes.get_xlim() for axes in scores.axes]):
        assert (limits[0] == limits[1]) is together
    assert curves.axes[0].get_xlim() == curves.axes[1].get_xlim()


def test_a_name_that_a_folder_cuts_is_whole_in_labels(write_run: WriteRun, tmp_path: Path) -> None:
    words = ["experiment=advertiser", "replicas=1", "mixer.alpha=.3", "trainer.steps=700", "surrogates.mine.steps=2"]
    cut = "mixer.alpha=0.3,surrogates.mine.steps=2,trai-9c800baf"
    write_run("reference", 0, {"regret/cumulative": 5.0}, trainer=SHORT, slug="trainer.steps=700")
    folder = write_run("reference", 0, {"regret/cumulative": 5.0}, trainer=SHORT, slug=cut)
    summary = json.loads((folder / "summary.json").read_text()) | {"session": "s-1", "job": "s-1-0"}
    (folder / "summary.json").write_text(json.dumps(summary))
    record = tmp_path / "outputs" / "sessions" / "s-1" / "job-0.json"
    record.parent.mkdir(parents=True)
    record.write_text(json.dumps({"overrides": words}))
    (part,) = load_runs(tmp_path / "outputs", "advertiser").by_setting()
    whole = "mixer.alpha=0.3,surrogates.mine.steps=2"
    assert part.frame["slug"].tolist() == ["default", whole]  # the budget makes the setting, and no variant
    assert list(row_names([summarise(part)]).values()) == ["Ridge-UCB", "Ridge-UCB\nalpha=0.3, steps=2"]
    assert "trainer.steps=700" in title([summarise(part)])
    for asked in (cut, whole, "mixer.alpha=.3,surrogates.mine.steps=2,trainer.steps=700"):
        assert load_runs(tmp_path / "outputs", "advertiser", slugs=[asked]).frame["slug"].tolist() == [whole]
    record.unlink()
    assert cut in load_runs(tmp_path / "outputs", "advertiser").frame["slug"].tolist()


def test_a_very_long_name_is_folded(write_run: WriteRun, tmp_path: Path) -> None:
    slugs = [f"surrogates.mine.formula={'1+s+a+'.join('xy' * 20)}{end}" for end in ("A", "B")]
    for slug in ("default", *(slug[:180] + slug[-1] for slug in slugs)):
        write_run("disagreement", 0, {"regret/cumulative": 5.0}, slug=slug)
    comparison = summarise(load_runs(tmp_path / "outputs", "advertiser"))
    assert len({*row_names([comparison]).values()}) == 3
    for figure in figures(comparison):
        assert_all_inside(figure)
        assert min(widths(figure)) > 3.2

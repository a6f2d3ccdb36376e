"""Pictures of a maze: what is drawn is what the run folder has, and runs that lack something are left out."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from credit.core.errors import UserError
from credit.report import style
from credit.report.compare import compare
from credit.report.comparison import summarise
from credit.report.pointmaze.figures import maze_figures
from credit.report.pointmaze.maps import beliefs_figure, load_beliefs, raster
from credit.report.pointmaze.pictures import KINDS, MISSED, REACHED, WALL
from credit.report.pointmaze.tracks import load_tracks, typical
from credit.report.recovered import recovered_maps
from credit.report.runs import load_runs

from .mazes import GOAL, MAZE, MODELS, START, journal, recovery, write_maze_run

RATES = [0.5, 0.9, 1.0, 1.0, 0.95]


def write_all(output: Path) -> Path:
    """Three methods, three seeds: one with several models, one with one, one with none."""
    for seed in range(3):
        tracks = journal(seed=seed)
        write_maze_run(output, "disagreement", seed, RATES, tracks=tracks, beliefs=recovery(seed=seed))
        write_maze_run(output, "reference", seed, RATES, tracks=tracks, beliefs=recovery(models=["dnn"], seed=seed))
        write_maze_run(output, "delayed", seed, RATES, tracks=tracks)
    return output


def draw(output: Path, seed: int | None = None) -> dict[str, Figure | None]:
    with style.styled():
        return maze_figures([summarise(load_runs(output, "pointmaze"))], seed)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folders that no test changes."""
    return write_all(tmp_path_factory.mktemp("maze"))


@pytest.fixture(scope="module")
def figures(shared: Path) -> dict[str, Figure | None]:
    return draw(shared)


def pixels(figure: Figure) -> Any:
    """The picture as red, green and blue [rows, columns, 3], and where its data lie."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="raw", dpi=100, facecolor="white")
    width, height = (round(size * 100) for size in figure.get_size_inches())
    return np.frombuffer(buffer.getvalue(), dtype=np.uint8).reshape(height, width, 4)[..., :3] / 255


def colour_at(picture: Any, axes: Axes, place: tuple[float, float]) -> Any:
    across, up = axes.transData.transform(place)
    return picture[len(picture) - 1 - round(up), round(across)]


def lines(axes: Axes) -> LineCollection:
    (found,) = [part for part in axes.collections if isinstance(part, LineCollection)]
    return found


def test_every_method_has_its_pictures(figures: dict[str, Figure | None]):
    assert set(figures) == {
        "demonstrations",
        *(f"trajectories_{method}" for method in ("delayed", "reference", "disagreement")),
        *(f"{kind}_{method}" for kind in ("maps", "doubts") for method in ("reference", "disagreement")),
    }


def test_figure_1_draws_every_demonstration_in_the_colour_of_its_kind(figures: dict[str, Figure | None]):
    figure = figures["demonstrations"]
    assert figure is not None
    (axes,) = figure.axes
    states, lengths = (journal()[f"demonstrations/{name}"] for name in ("states", "lengths"))
    expected = np.split(states[:, :2], np.cumsum(lengths)[:-1])
    # two of each kind, the successes on top
    order = [2, 3, 4, 5, 0, 1]
    for drawn, index in zip(lines(axes).get_segments(), order, strict=True):
        assert drawn == pytest.approx(expected[index])
    shades = [to_rgb(KINDS[kind]) for kind in ("partial", "partial", "failure", "failure", "success", "success")]
    assert lines(axes).get_colors()[:, :3].tolist() == [list(shade) for shade in shades]
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["start", "goal", "success (2)", "partial (2)", "failure (2)"]
    assert axes.get_aspect() == 1.0


def test_walls_are_grey_and_start_and_goal_are_where_they_are(figures: dict[str, Figure | None]):
    figure = figures["demonstrations"]
    assert figure is not None
    picture, axes = pixels(figure), figure.axes[0]
    for row, column in np.ndindex(*MAZE.grid.shape):
        x, y = MAZE.xy((row, column))
        corner = (x - 0.44, y + 0.44)  # of a cell, where no line is drawn
        grey = colour_at(picture, axes, corner) == pytest.approx(to_rgb(WALL), abs=0.01)
        assert grey == MAZE.grid[row, column]
    marks = [tuple(line.get_xydata()[0]) for line in axes.lines]
    assert marks == [MAZE.xy(START), MAZE.xy(GOAL)]


def test_trajectories_by_time_and_by_success(figures: dict[str, Figure | None]):
    figure = figures["trajectories_delayed"]
    assert figure is not None
    by_time, online, last = figure.axes[:3]
    arrays = journal(seed=1)  # all seeds are alike, the second is the median
    assert len(lines(by_time).get_segments()) == len(arrays["online/lengths"]) == 10
    assert len(np.unique(lines(by_time).get_colors(), axis=0)) == 10
    for axes, part in ((online, "online"), (last, "evaluation")):
        shades = [to_rgb(REACHED if label else MISSED) for label in arrays[f"{part}/labels"]]
        assert lines(axes).get_colors()[:, :3].tolist() == [list(shade) for shade in shades]
        reached = int(arrays[f"{part}/labels"].sum())
        assert f"{reached} of {len(shades)} reach the goal" in axes.get_title("left")
    assert figure.get_suptitle() == "pointmaze: Delayed SAC, median seed 1"


@pytest.mark.thorough
def test_a_seed_can_be_chosen(shared: Path):
    figures = draw(shared, seed=2)
    titles = [figures[name].get_suptitle() for name in ("trajectories_delayed", "maps_disagreement")]  # type: ignore[union-attr]
    assert titles == ["pointmaze: Delayed SAC, seed 2", "pointmaze: Disagreement-SAC, seed 2"]
    with pytest.raises(UserError, match=r"diagnostics_seed=7 is not among the finished seeds of Delayed SAC: 0 to 2"):
        draw(shared, seed=7)


def test_the_typical_seed_has_the_lower_median_success(tmp_path: Path):
    for seed, rate in enumerate([0.9, 0.2, 0.6, 0.4, 0.5]):
        write_maze_run(tmp_path, "delayed", seed, [rate], tracks=journal() if seed != 4 else None)
    comparison = summarise(load_runs(tmp_path, "pointmaze"))
    run = typical(comparison.runs.frame, comparison, None)
    assert run is not None
    assert run["seed"] == 3  # of .2 .4 .6 .9: seed 4 kept no trajectories


def test_maps_are_means_over_seeds_at_the_first_middle_and_last_refit(shared: Path):
    group = load_runs(shared, "pointmaze", methods=["disagreement"]).frame
    beliefs = load_beliefs(group)
    assert beliefs is not None
    assert (beliefs.seeds, beliefs.trajectories) == (3, (0, 10, 20))
    files = [recovery(seed=seed) for seed in range(3)]
    assert list(beliefs.rewards) == [*MODELS, "mixed"]
    for model, values in beliefs.rewards.items():
        assert values == pytest.approx(np.mean([arrays[f"reward/{model}"][[0, 2, 4]] for arrays in files], axis=0))
    for model, values in beliefs.weights.items():
        assert values == pytest.approx(np.mean([arrays[f"weight/{model}"][[0, 2, 4]] for arrays in files], axis=0))
    assert beliefs.best is not None
    for place, refit in enumerate((0, 2, 4)):
        for point in range(len(beliefs.states)):
            votes = np.bincount([arrays["best"][refit, point] for arrays in files], minlength=3)
            assert beliefs.best[place, point] == votes.argmax()


def test_a_raster_puts_every_point_in_its_place():
    states = recovery()["grid/states"]
    image = raster(MAZE, states, np.arange(len(states)))
    assert image.shape == (16, 20)
    assert np.isnan(image).sum() == 16 * len(MAZE.wall_cells)
    for number, (x, y) in enumerate(states[:, :2]):
        # a pixel is a quarter of a metre; the first is at the top left
        assert image[int((2 - y) / 0.25), int((x + 2.5) / 0.25)] == number


def test_maps_show_every_model_and_the_best_one(shared: Path):
    group = load_runs(shared, "pointmaze").frame
    several = load_beliefs(group[group["method"] == "disagreement"])
    alone = load_beliefs(group[group["method"] == "reference"])
    assert several is not None
    assert alone is not None
    left, right = beliefs_figure("A", several).subfigs
    names = [[axes.get_ylabel() for axes in part.axes if axes.get_ylabel()] for part in (left, right)]
    assert names == [[*MODELS, "mixture"], [*MODELS, "best model"]]
    (only,) = beliefs_figure("B", alone).subfigs
    assert [axes.get_ylabel() for axes in only.axes if axes.get_ylabel()] == ["dnn"]
    drawn = [axes.images[0].get_array() for axes in only.axes if axes.images]
    assert len(drawn) == 3
    assert drawn[2].compressed() == pytest.approx(
        raster(MAZE, alone.states, alone.rewards["dnn"][2])[~np.isnan(drawn[2])]
    )


def test_recoveries_over_a_maze_are_no_tables(shared: Path):
    assert recovered_maps(load_runs(shared, "pointmaze")) is None


def test_runs_that_kept_nothing_are_compared_without_pictures(tmp_path: Path):
    write_maze_run(tmp_path, "disagreement", 0, RATES, beliefs=recovery())
    write_maze_run(tmp_path, "delayed", 0, RATES)
    report = compare(tmp_path, "pointmaze")
    names = {path.stem for path in report.files}
    assert names == {"table", "runs", "curves", "distribution"}
    assert report.remark == ""


@pytest.mark.thorough
def test_variants_have_pictures_of_their_own_and_every_maze_its_demonstrations(tmp_path: Path):
    output = write_all(tmp_path)
    start, goal = (1, 2), (2, 2)
    write_maze_run(output, "delayed", 0, RATES, slug="scaler=plain", tracks=journal())
    moved = {"start": [1, 2], "goal": [2, 2]}
    tracks = journal(start=start, goal=goal)
    write_maze_run(output, "delayed", 0, RATES, slug="env.goal=2,2,env.start=1,2", tracks=tracks, env=moved)
    with style.styled():
        figures = maze_figures([summarise(part) for part in load_runs(output, "pointmaze").by_setting()], None)
    assert "trajectories_terminal-goal=2,2-start=1,2_delayed" in figures
    assert any(name.endswith("_delayed_scaler=plain") for name in figures)
    demonstrations = figures["demonstrations"]
    assert demonstrations is not None
    assert len(demonstrations.axes) == 2


@pytest.mark.thorough
def test_old_pictures_do_not_stay(tmp_path: Path):
    output = write_all(tmp_path)
    folder = output / "reports" / "pointmaze-method=reference"
    folder.mkdir(parents=True)
    for name in ("trajectories_gone", "maps_gone", "policy_gone_seed-0"):
        (folder / f"{name}.svg").touch()
    report = compare(output, "pointmaze", methods=["reference"], videos=False)
    assert {path.stem for path in report.files if path.suffix == ".svg"} == {
        *("curves", "distribution", "demonstrations", "trajectories_reference", "maps_reference"),
        "doubts_reference",
    }
    assert not list(folder.glob("*_gone.*"))


def test_a_damaged_file_is_named(tmp_path: Path):
    output = write_all(tmp_path)
    folder = output / "pointmaze" / "delayed" / "default" / "seed-0"
    (folder / "trajectories.npz").write_bytes(b"PK")
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its trajectories\.npz"):
        load_tracks(str(folder))

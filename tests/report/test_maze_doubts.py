"""Maps of how far the beliefs over a maze can be trusted: MSE proxies, disagreement and visits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from credit.report.comparison import summarise
from credit.report.pointmaze.doubts import doubts_figure, load_doubts, visited
from credit.report.pointmaze.figures import maze_figures
from credit.report.pointmaze.tracks import load_tracks
from credit.report.runs import load_runs

from .mazes import MAZE, MODELS, journal, recovery, write_maze_run

RATES = [0.5, 1.0]


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Two seeds of a method with three models, and one run of a method with one model."""
    for seed in range(2):
        write_maze_run(tmp_path, "disagreement", seed, RATES, tracks=journal(seed=seed), beliefs=recovery(seed=seed))
    write_maze_run(tmp_path, "reference", 0, RATES, tracks=journal(), beliefs=recovery(models=["dnn"]))
    return tmp_path


def test_doubts_are_roots_and_means_over_seeds(runs: Path) -> None:
    doubts = load_doubts(load_runs(runs, "pointmaze", methods=["disagreement"]).frame)
    assert doubts is not None
    assert (doubts.seeds, doubts.trajectories) == (2, (0, 10, 20))
    files = [recovery(seed=seed) for seed in range(2)]
    assert list(doubts.proxies) == [*MODELS]
    assert list(doubts.gaps) == [*MODELS[1:]]
    for name, tables in (("mse", doubts.proxies), ("disagreement", doubts.gaps)):
        for model, values in tables.items():
            expected = np.mean([np.sqrt(arrays[f"{name}/{model}"][[0, 2, 4]]) for arrays in files], axis=0)
            assert values == pytest.approx(expected)


def test_visits_are_the_steps_that_were_driven_until_then(runs: Path) -> None:
    frame = load_runs(runs, "pointmaze", methods=["disagreement"]).frame
    driven = load_tracks(frame["folder"].iloc[0])
    states = recovery()["grid/states"][:, :2]
    before, later = (visited(driven, states, count) for count in (0, 10))
    side = 1 / 4  # of the square around a point
    for count, trajectories in ((before, 0), (later, 10)):
        places = np.concatenate([*driven.demonstrations.places, *driven.online.places[:trajectories]])
        for number in (0, 5, len(states) - 1):
            near = (np.abs(places - states[number]) < side / 2).all(axis=1)
            assert count[number] == near.sum()
    assert (later >= before).all()
    assert later.sum() > before.sum()
    assert len(states) == 16 * len(MAZE.free)


def test_a_figure_has_a_row_a_model_and_one_of_visits(runs: Path) -> None:
    frame = load_runs(runs, "pointmaze").frame
    for method, left, right in (
        ("disagreement", [*MODELS], [*(f"|dnn − {model}|" for model in MODELS[1:]), "visits"]),
        ("reference", ["dnn"], ["visits"]),
    ):
        doubts = load_doubts(frame[frame["method"] == method])
        assert doubts is not None
        parts = doubts_figure("A", doubts).subfigs
        names = [[axes.get_ylabel() for axes in part.axes if axes.get_ylabel()] for part in parts]
        assert names == [left, right]
        bar = parts[1].axes[-1]
        assert not any("$" in text.get_text() for text in bar.get_yticklabels())


def test_runs_without_proxies_have_no_such_figure(tmp_path: Path) -> None:
    beliefs = {key: values for key, values in recovery().items() if not key.startswith(("mse/", "disagreement/"))}
    write_maze_run(tmp_path, "disagreement", 0, RATES, tracks=journal(), beliefs=beliefs)
    names = set(maze_figures([summarise(load_runs(tmp_path, "pointmaze"))], None))
    assert names == {"demonstrations", "trajectories_disagreement", "maps_disagreement"}

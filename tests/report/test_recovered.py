from pathlib import Path
from typing import Any

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.report.heatmaps import heatmaps_figure
from credit.report.recovered import Maps, recovered_maps
from credit.report.runs import load_runs

from .conftest import WriteRun

S, A, T = 30, 4, 5
SMALL = ["true", "ridge", "health", "mixed"]


def synthetic(seed: int, cells: list[str] | None, shape: tuple[int, ...]) -> dict[str, Any]:
    """Tables without any structure, and two axes: `ward` 0–2 across, `dose` 0–1 up; (2, 1) has no cell."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, Any] = {f"reward/{name}": rng.normal(size=shape) for name in SMALL}
    arrays |= {"models": np.array(["ridge", "health"]), "weight/ridge": rng.uniform(size=shape)}
    places = np.random.default_rng(7)
    ward = places.integers(0, 3, size=shape)
    dose = np.where(ward == 2, 0, places.integers(0, 2, size=shape))
    arrays |= {"axis/ward": ward.astype(np.int8), "axis/dose": dose.astype(np.int8)}
    # nobody was ever on ward 1 with dose 0
    arrays["visits"] = np.where((ward == 1) & (dose == 0), 0, rng.integers(0, 9, size=shape)).astype(float)
    return arrays | ({"cells": np.array(cells)} if cells else {})


def maps_of(write_run: WriteRun, tmp_path: Path, files: list[dict[str, Any]], seed: int | None = None) -> Maps | None:
    for number, arrays in enumerate(files):
        write_run("disagreement", number, {"regret/cumulative": 1.0}, recovery=arrays)
    return recovered_maps(load_runs(tmp_path / "outputs", "advertiser"), seed)


def by_hand(files: list[dict[str, Any]], key: str, ward: int, dose: int, steps: range | None = None) -> float:
    """The mean of a field, one cell at a time."""
    values, weights = [], []
    for arrays in files:
        for place in np.ndindex(arrays[key].shape):
            inside = arrays["axis/ward"][place] == ward and arrays["axis/dose"][place] == dose
            if inside and (steps is None or place[0] in steps):
                values.append(arrays[key][place])
                weights.append(arrays["visits"][place])
    if not values:
        return float("nan")
    if sum(weights) == 0:
        return float(np.mean(values))
    return float(sum(v * w for v, w in zip(values, weights, strict=True)) / sum(weights))


@pytest.mark.parametrize(
    ("cells", "shape"), [(None, (S, A)), (["state", "action"], (S, A)), (["next_state"], (S * A,))]
)
def test_large_tables_are_averaged_over_two_axes(
    write_run: WriteRun, tmp_path: Path, cells: list[str] | None, shape: tuple[int, ...]
):
    files = [synthetic(seed, cells, shape) for seed in range(2)]
    maps = maps_of(write_run, tmp_path, files)
    assert maps is not None
    assert (maps.axes, maps.by_cell, len(maps.blocks)) == (("ward", "dose"), False, 1)
    said = "end of training, mean over 2 seeds, weighted by visits; hatched: never visited"
    assert maps.title == f"advertiser: Disagreement-UCB, {said}"
    block = maps.blocks[0]
    drawn = dict(zip(SMALL, block.tables.values(), strict=True))
    for ward, dose in np.ndindex(3, 2):
        for name in SMALL:
            assert drawn[name][dose, ward] == pytest.approx(
                by_hand(files, f"reward/{name}", ward, dose), nan_ok=True, abs=1e-12
            )
        assert block.last[dose, ward] == pytest.approx(by_hand(files, "weight/ridge", ward, dose), nan_ok=True)
    assert block.seen.tolist() == [[True, False, True], [True, True, False]]
    assert np.isnan(block.last[1, 2])
    assert not np.isnan(block.last[0, 1])


def test_one_seed_can_be_drawn_alone(write_run: WriteRun, tmp_path: Path):
    files = [synthetic(seed, None, (S, A)) for seed in range(2)]
    maps = maps_of(write_run, tmp_path, files, seed=1)
    assert maps is not None
    assert maps.blocks[0].last[0, 0] == pytest.approx(by_hand(files[1:], "weight/ridge", 0, 0))


def test_the_last_step_stands_apart(write_run: WriteRun, tmp_path: Path):
    files = [synthetic(seed, ["step", "next_state"], (T, S)) for seed in range(2)]
    maps = maps_of(write_run, tmp_path, files)
    assert maps is not None
    assert [block.title for block in maps.blocks] == ["steps 1–4", "step 5"]
    for block, steps in zip(maps.blocks, (range(4), range(4, 5)), strict=True):
        for ward, dose in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]:
            assert list(block.tables.values())[-1][dose, ward] == pytest.approx(
                by_hand(files, "reward/mixed", ward, dose, steps)
            )
        gaps = [((arrays["reward/ridge"] - arrays["reward/true"]) ** 2)[list(steps)] for arrays in files]
        assert list(block.tables)[1] == f"Ridge reward (MSE {np.mean(gaps):.2g})"


@pytest.mark.parametrize(
    ("steps", "titles"), [(1, ["step 1"]), (2, ["step 1", "step 2"]), (3, ["steps 1–2", "step 3"])]
)
def test_steps_are_named(write_run: WriteRun, tmp_path: Path, steps: int, titles: list[str]):
    maps = maps_of(write_run, tmp_path, [synthetic(0, ["step", "next_state"], (steps, 100))])
    assert maps is not None
    assert [block.title for block in maps.blocks] == titles


def test_small_tables_are_drawn_cell_by_cell_whatever_was_visited(write_run: WriteRun, tmp_path: Path):
    files = [synthetic(seed, ["step", "next_state"], (3, 4)) for seed in range(2)]
    maps = maps_of(write_run, tmp_path, files)
    assert maps is not None
    assert (maps.by_cell, maps.axes) == (True, ("next state",))
    mixed = np.mean([arrays["reward/mixed"] for arrays in files], axis=0)
    earlier, last = (list(block.tables.values())[-1] for block in maps.blocks)
    assert earlier == pytest.approx(mixed[:2].mean(axis=0, keepdims=True))
    assert last == pytest.approx(mixed[2:])
    assert "visited" not in maps.title


def test_a_table_of_another_shape_is_not_drawn(write_run: WriteRun, tmp_path: Path):
    arrays = synthetic(0, ["step", "next_state"], (T, S)) | {"reward/true": np.zeros(S)}
    assert maps_of(write_run, tmp_path, [arrays]) is None


def test_every_table_has_a_panel_and_every_step_a_title(write_run: WriteRun, tmp_path: Path):
    maps = maps_of(write_run, tmp_path, [synthetic(0, ["step", "next_state"], (T, S))])
    assert maps is not None
    figure = heatmaps_figure(maps)
    panels = [axes for axes in figure.axes if axes.get_visible() and axes.get_title()]
    assert [axes.get_title().split(" (")[0] for axes in panels] == 2 * [
        *("True reward", "Ridge reward", "Health reward", "Mixed reward", "Weight of ridge")
    ]
    assert {(axes.get_xlabel(), axes.get_ylabel()) for axes in panels} == {("ward", "dose")}
    assert [part.get_suptitle() for part in figure.subfigs] == ["steps 1–4", "step 5"]
    # a hatched field a panel for what was never visited, none where there is no cell
    assert [len(axes.patches) for axes in panels] == [1] * 10
    assert [len(axes.texts) for axes in panels] == [5] * 10


def test_doubts_are_drawn_in_units_of_the_reward_beside_visits(write_run: WriteRun, tmp_path: Path):
    files = [synthetic(seed, ["state", "action"], (3, 4)) for seed in range(2)]
    for seed, arrays in enumerate(files):
        rng = np.random.default_rng(10 + seed)
        arrays |= {key: rng.uniform(size=(3, 4)) for key in ("mse/ridge", "mse/health", "disagreement/health")}
    maps_of(write_run, tmp_path, files)
    maps = recovered_maps(load_runs(tmp_path / "outputs", "advertiser"), doubts=True)
    assert maps is not None
    (block,) = maps.blocks
    assert list(block.tables) == ["√MSE proxy of ridge", "√MSE proxy of health", "|ridge − health|"]
    for key, table in zip(("mse/ridge", "mse/health", "disagreement/health"), block.tables.values(), strict=True):
        assert table == pytest.approx(np.mean([np.sqrt(arrays[key]) for arrays in files], axis=0).T)
    assert block.last == pytest.approx(np.mean([arrays["visits"] for arrays in files], axis=0).T)
    figure = heatmaps_figure(maps)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible() and axes.get_title()]
    assert titles == [*block.tables, "Visits"]
    assert [text.get_text() for text in figure.axes[5].texts if "." in text.get_text()] == []  # counted, not rounded


def test_where_nothing_is_doubted_there_is_no_such_map(write_run: WriteRun, tmp_path: Path):
    maps_of(write_run, tmp_path, [synthetic(0, ["state", "action"], (3, 4))])
    assert recovered_maps(load_runs(tmp_path / "outputs", "advertiser"), doubts=True) is None


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive"])
def test_damaged_tables_are_named(write_run: WriteRun, tmp_path: Path, content: bytes):
    (write_run("disagreement", 0, {"regret/cumulative": 1.0}) / "recovery.npz").write_bytes(content)
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its recovery\.npz cannot be used"):
        recovered_maps(load_runs(tmp_path / "outputs", "advertiser"))


def test_tables_that_lack_an_array_are_named(write_run: WriteRun, tmp_path: Path):
    arrays = synthetic(0, None, (S, A))
    del arrays["models"]
    with pytest.raises(UserError, match=r"recovery\.npz cannot be used \(KeyError"):
        maps_of(write_run, tmp_path, [arrays])

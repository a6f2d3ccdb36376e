"""The picture of what a seed believes."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from credit.tracking.picture import _coloured, _placed, recovery_picture


def texts(picture: str) -> list[str]:
    """All words of a picture."""
    return [str(part.text) for part in ElementTree.fromstring(picture).iter() if part.tag.endswith("text")]


def test_every_table_of_cells_has_a_panel(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    table = np.array([[0.0, -1.0], [np.nan, 2.0]])
    others = {"draws/ridge": np.zeros((5, 2, 2)), "policy": np.zeros(2)}
    np.savez(file, **{"weight/a<b": table, "reward/mixed": table, "reward/true": table, **others})
    picture = recovery_picture(file)
    assert picture is not None
    *told, foot = texts(picture)
    assert told == ["reward/true", "-1 … 2", "reward/mixed", "-1 … 2", "weight/a<b", "-1 … 2"]
    assert foot == "state down, action across; blue is below 0, orange above, grey unknown; one scale a kind"


def test_what_is_believed_at_places_is_drawn_there_as_of_the_last_fit(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    states = np.array([[0.5, 0.5, 0.0], [1.5, 0.5, 0.0], [0.5, 1.5, 0.0]])  # x, y and what else a state is made of
    fits = np.array([[9.0, 9.0, 9.0], [1.0, 2.0, 3.0]])
    np.savez(file, **{"grid/states": states, "reward/mixed": fits, "disagreement/b": fits, "rounds": np.array([0, 5])})
    picture = recovery_picture(file)
    assert picture is not None
    *told, foot = texts(picture)
    assert told == ["reward/mixed", "1 … 3", "disagreement/b", "1 … 3"]
    assert foot.startswith("the last fit, x to the right, y upwards; ")
    placed = _placed(states, fits[-1])
    assert placed is not None
    assert placed.tolist()[1] == [1.0, 2.0]
    assert placed[0, 0] == 3.0
    assert np.isnan(placed[0, 1])


def test_states_that_are_no_grid_of_places_have_no_picture(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    states = np.random.default_rng(0).normal(size=(300, 4))
    np.savez(file, **{"grid/states": states, "reward/mixed": np.zeros((2, 300))})
    assert recovery_picture(file) is None


def test_without_tables_there_is_none(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    assert recovery_picture(file) is None
    np.savez(file, policy=np.zeros(3))
    assert recovery_picture(file) is None


def test_below_and_above_zero_are_told_apart() -> None:
    below, nothing, above, unknown = _coloured(np.array([[-1.0, 0.0, 1.0, np.nan]]), 1.0)[0].tolist()
    assert (below[2] > below[0], nothing[0] == nothing[2], above[0] > above[2]) == (True, True, True)
    assert unknown == [0xC0] * 3

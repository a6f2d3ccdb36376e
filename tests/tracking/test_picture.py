"""The picture of what a seed believes."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from credit.tracking.picture import _coloured, recovery_picture


def test_every_table_of_cells_has_a_panel(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    table = np.array([[0.0, -1.0], [np.nan, 2.0]])
    others = {"draws/ridge": np.zeros((5, 2, 2)), "policy": np.zeros(2)}
    np.savez(file, **{"weight/a<b": table, "reward/mixed": table, "reward/true": table, **others})
    picture = recovery_picture(file)
    assert picture is not None
    texts = [element.text for element in ElementTree.fromstring(picture).iter() if element.tag.endswith("text")]
    assert texts == ["reward/true", "-1 … 2", "reward/mixed", "-1 … 2", "weight/a<b", "-1 … 2"]


def test_without_tables_there_is_none(tmp_path: Path) -> None:
    file = tmp_path / "recovery.npz"
    assert recovery_picture(file) is None
    np.savez(file, policy=np.zeros(3))
    assert recovery_picture(file) is None


def test_below_and_above_zero_are_told_apart() -> None:
    below, nothing, above, unknown = _coloured(np.array([[-1.0, 0.0, 1.0, np.nan]]), 1.0)[0].tolist()
    assert (below[2] > below[0], nothing[0] == nothing[2], above[0] > above[2]) == (True, True, True)
    assert unknown == [0xC0] * 3

"""Files of steps: every column comes back, and what is wrong in one is told by column and row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.data.tables import numbered, read, write

GOOD: dict[str, Any] = {
    "episode": ["a", "a", "b"],
    "observation_0": [0.5, 1.5, 0.25],
    "observation_1": [1, 2, 3],
    "action": [0, 1, 0],
    "next_observation_0": [1.5, 2.5, 0.5],
    "next_observation_1": [2, 3, 4],
    "reward": [1.0, 2.0, 4.0],
    "terminated": [False, True, False],
}


def written(folder: Path, **changed: Any) -> Path:
    """A file with some columns changed, None for one that is left out."""
    columns = {name: values for name, values in (GOOD | changed).items() if values is not None}
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def test_columns_come_back(tmp_path: Path) -> None:
    found = read(written(tmp_path))
    assert found["observation"].tolist() == [[0.5, 1], [1.5, 2], [0.25, 3]]
    assert found["next_observation"].tolist() == [[1.5, 2], [2.5, 3], [0.5, 4]]
    assert found["action"].tolist() == [0, 1, 0]
    assert found["episode"].tolist() == [0, 0, 1]
    assert found["terminated"].tolist() == [0, 1, 0]
    assert found["reward"].tolist() == [1, 2, 4]


def test_parquet_comes_back_to_the_bit(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).normal(size=(4, 3)).astype(np.float32)
    columns = {"observation": numbers, "action": np.arange(4), "next_observation": numbers, "label": numbers[:, 0]}
    write(tmp_path / "steps.parquet", columns)
    found = read(tmp_path / "steps.parquet")
    assert all(np.array_equal(found[name], column) for name, column in columns.items())
    assert [file.name for file in tmp_path.iterdir()] == ["steps.parquet"]


def test_stretches_are_numbered() -> None:
    assert numbered(np.array([5, 5, 2, 5])).tolist() == [0, 0, 1, 2]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"rewards": [0, 0, 0]}, "unknown column 'rewards'; did you mean 'reward'"),
        ({"reward": None}, "neither a column label nor reward"),
        ({"action": None}, "no column action, and no action_0"),
        ({"observation_0": None}, "no column observation, and no observation_0"),
        ({"observation": [1, 2, 3]}, "there is observation, and observation_0 as well"),
        ({"action": [0, "left", 1]}, "action of row 1 is 'left': it must be a number"),
        ({"reward": [1, np.nan, 2]}, "reward of row 1 is nan"),
        ({"observation_1": [1, 2, np.inf]}, "observation_1 of row 2 is inf"),
        ({"terminated": [0, 0, 2]}, "terminated of row 2 is 2: allowed are 0 and 1"),
        ({"label": [0, np.inf, 2]}, "label of row 1 is inf"),
    ],
)
def test_what_is_wrong_is_told_by_column_and_row(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        read(written(tmp_path, **changed))


def test_files_that_are_none_are_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        read(tmp_path / "log.csv")
    (tmp_path / "bad.parquet").write_bytes(b"nothing")
    with pytest.raises(UserError, match=r"cannot be read.*the columns observation"):
        read(tmp_path / "bad.parquet")

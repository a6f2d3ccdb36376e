"""What Minari wrote comes back episode by episode, whatever its spaces."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.data.minari import episodes

from ..minari_datasets import written

pytest.importorskip("minari")
pytestmark = pytest.mark.filterwarnings("ignore:.*env.*:UserWarning")
LENGTHS = (3, 1, 4)


def episode(seed: int, steps: int) -> dict[str, Any]:
    numbers = np.random.default_rng(seed)
    inner = {"far": numbers.normal(size=(steps + 1, 5, 2))}
    observed = {"here": numbers.normal(size=(steps + 1, 3)), "views": inner}
    return {"observations": observed, "actions": numbers.uniform(-1, 1, (steps, 1)).astype(np.float32)}


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    written("mine/some-v0", [episode(number, steps) for number, steps in enumerate(LENGTHS)])
    return tmp_path


def test_episodes_come_back(store: Path) -> None:
    for source in ("mine/some-v0", store / "mine" / "some-v0", store / "mine" / "some-v0" / "data"):
        found = list(episodes(source))
        assert [one.number for one in found] == [0, 1, 2]
        for one, steps in zip(found, LENGTHS, strict=True):
            expected = episode(one.number, steps)
            assert np.array_equal(one.actions, expected["actions"])
            assert np.array_equal(one.observations["here"], expected["observations"]["here"])
            assert np.array_equal(one.observations["views"]["far"], expected["observations"]["views"]["far"])
    assert [one.number for one in episodes("mine/some-v0", limit=2)] == [0, 1]


@pytest.mark.parametrize(
    ("part", "left", "message"),
    [
        (
            "observations/views/far",
            3,
            r"with 3 actions has observations\['views'\]\['far'\] .*\(3, 5, 2\).* 4",
        ),
        ("actions", 2, r"episode 0 with 2 actions has observations\['here'\] of shape \(4, 3\).* 3 rows"),
        ("actions", 0, "episode 0 has no steps"),
    ],
)
def test_episodes_that_are_none_are_named(store: Path, part: str, left: int, message: str) -> None:
    import h5py

    with h5py.File(store / "mine" / "some-v0" / "data" / "main_data.hdf5", "r+") as file:
        kept = file[f"episode_0/{part}"][:left]
        del file[f"episode_0/{part}"]
        file[f"episode_0/{part}"] = kept
    with pytest.raises(UserError, match=message):
        list(episodes("mine/some-v0"))


def test_what_is_not_there_is_said(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="`minari download mine/none-v0`"):
        list(episodes("mine/none-v0"))
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(UserError, match=r"pip install 'minari\[hdf5\]'"):
        list(episodes("mine/some-v0"))

"""What Minari wrote comes back episode by episode, whatever its spaces."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.data.minari import episodes

from ..minari_datasets import written

pytest.importorskip("minari")
h5py = pytest.importorskip("h5py")
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
    with h5py.File(store / "mine" / "some-v0" / "data" / "main_data.hdf5", "r+") as file:
        kept = file[f"episode_0/{part}"][:left]
        del file[f"episode_0/{part}"]
        file[f"episode_0/{part}"] = kept
    with pytest.raises(UserError, match=message):
        list(episodes("mine/some-v0"))


def test_a_dataset_that_lacks_what_minari_writes(store: Path) -> None:
    file = store / "mine" / "some-v0" / "data" / "metadata.json"
    known = json.loads(file.read_text())
    del known["minari_version"]
    file.write_text(json.dumps(known))
    with pytest.raises(UserError, match=r"some-v0: the dataset cannot be read \(KeyError: 'minari_version'\)"):
        list(episodes(store / "mine" / "some-v0"))


@pytest.mark.parametrize("left", [100, 0.5, 0.9])
def test_half_a_file_is_named(store: Path, left: float) -> None:
    file = store / "mine" / "some-v0" / "data" / "main_data.hdf5"
    whole = file.read_bytes()
    file.write_bytes(whole[: int(left * len(whole) if left < 1 else left)])
    with pytest.raises(UserError, match=r"mine/some-v0.* cannot be read \("):
        list(episodes("mine/some-v0"))


@pytest.mark.parametrize("part", ["rewards", "terminations"])
def test_columns_are_as_long_as_the_episode(store: Path, part: str) -> None:
    with h5py.File(store / "mine" / "some-v0" / "data" / "main_data.hdf5", "r+") as file:
        kept = file[f"episode_2/{part}"][:2]
        del file[f"episode_2/{part}"]
        file[f"episode_2/{part}"] = kept
    with pytest.raises(UserError, match=rf"episode 2 with 4 actions has {part} \(2,\)"):
        list(episodes("mine/some-v0"))


def test_what_is_not_there_is_said(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="`minari download mine/none-v0`") as error:
        list(episodes("mine/none-v0"))
    assert "download=" not in str(error.value)
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(UserError, match=r"pip install 'minari\[hdf5\]'"):
        list(episodes("mine/some-v0"))


def test_a_file_is_no_dataset(tmp_path: Path) -> None:
    (tmp_path / "main_data.hdf5").write_bytes(b"HDF")
    with pytest.raises(UserError, match=r"main_data\.hdf5 is a file, and a Minari dataset is a folder"):
        next(episodes(tmp_path / "main_data.hdf5"))

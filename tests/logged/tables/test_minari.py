"""A Minari dataset as a table: a row a step, a label for each window of its rewards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import credit
from credit.core.errors import UserError
from credit.logged.tables import minari
from credit.logged.tables.opening import opened

from ...minari_datasets import written

pytest.importorskip("minari")
pytest.importorskip("h5py")
pytestmark = pytest.mark.filterwarnings("ignore:.*env.*:UserWarning")
NAME = "mine/walk-v0"


def episode(seed: int, steps: int) -> dict[str, Any]:
    numbers = np.random.default_rng(seed)
    seen = {"here": numbers.normal(size=(steps + 1, 2)), "far": numbers.normal(size=(steps + 1, 1))}
    actions = numbers.integers(0, 3, steps)
    actions[0] = 2  # so that all episodes have the same space
    rewards = (seen["here"][:-1, 0] + 2 * (actions == 1)).tolist()
    return {"observations": seen, "actions": actions, "rewards": rewards}


@pytest.fixture
def episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    found = [episode(number, 4 + number % 3) for number in range(30)]
    written(NAME, found)
    return found


def test_an_episode_is_a_window_whose_label_is_the_sum_of_rewards(
    episodes: list[dict[str, Any]], tmp_path: Path
) -> None:
    for data in (f"minari:{NAME}", tmp_path / NAME):
        panel = opened(data)
        assert panel.windows.steps.tolist() == [len(one["actions"]) for one in episodes]
        np.testing.assert_allclose(panel.windows.label, [sum(one["rewards"]) for one in episodes])
        assert {*panel.roles.states} == {"observation_here_0", "observation_here_1", "observation_far_0"}
        assert panel.columns["action"].levels == (0, 1, 2)
    assert any("an episode" in sentence for sentence in panel.said)


@pytest.mark.parametrize("label_is", ["sum", "mean", "last"])
def test_windows_may_be_parts_of_episodes(episodes: list[dict[str, Any]], label_is: str) -> None:
    panel = opened(f"minari:{NAME}", {"steps": 3, "label_is": label_is})
    of = {"sum": sum, "mean": lambda values: sum(values) / len(values), "last": lambda values: values[-1]}[label_is]
    wanted = [of(one["rewards"][at : at + 3]) for one in episodes for at in range(0, len(one["rewards"]), 3)]
    np.testing.assert_allclose(panel.windows.label, wanted)
    assert panel.roles.label_is == label_is


def test_what_made_the_rewards_is_found(episodes: list[dict[str, Any]]) -> None:
    found = credit.recover(f"minari:{NAME}", steps=2, draws=20, surrogates={})
    truth = np.concatenate([one["rewards"] for one in episodes])
    assert np.corrcoef(found.steps["credit"], truth)[0, 1] > 0.99


def test_what_cannot_be_is_refused(episodes: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="does not say what is a success"):
        opened(f"minari:{NAME}", {"label_is": "binary"})
    with pytest.raises(UserError, match="none-v0"):
        opened("minari:none-v0")
    with pytest.raises(UserError, match=r"data\.steps"):
        opened(f"minari:{NAME}", {"steps": 0})
    with pytest.raises(UserError, match=r"data\.steps has no effect"):
        opened("sales.csv", {"steps": 3})
    monkeypatch.setattr(minari, "LARGEST", 100)
    with pytest.raises(UserError, match="write it as Parquet"):
        opened(f"minari:{NAME}")


def test_labels_that_are_all_alike_or_bits_are_said(episodes: list[dict[str, Any]]) -> None:
    written("mine/nothing-v0", [{**one, "rewards": [0.0] * len(one["actions"])} for one in episodes])
    with pytest.raises(UserError, match=r"all 30 labels are 0 \(of rewards from 0 to 0\).*take episodes that differ"):
        opened("minari:mine/nothing-v0")
    written("mine/bits-v0", [{**one, "rewards": [0.0] * (len(one["actions"]) - 1) + [i % 2.0]}
                             for i, one in enumerate(episodes)])  # fmt: skip
    assert any(
        "label is 0 or 1 in all windows, and taken as a number" in one for one in opened("minari:mine/bits-v0").said
    )
    assert not any("0 or 1" in one for one in opened("minari:mine/bits-v0", {"label_is": "sum"}).said)


def test_a_dataset_without_its_steps_is_named(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "metadata.json").write_text("{}")
    with pytest.raises(UserError, match=r"its steps are missing \(main_data\.hdf5\)"):
        opened(tmp_path)

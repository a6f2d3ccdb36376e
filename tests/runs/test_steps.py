"""The windows of a finished run as a table: all of them, in order, and what a run starts from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import credit
from credit.core.errors import UserError
from credit.runs.steps import learned

SHORT = ("trainer.steps=70", "method=reference", "tracking=none")
CARTPOLE = (
    *("env=gymnasium", "env.id=CartPole-v1", "method=reference", "feedback=block_sum", "tracking=none", "replicas=1"),
    *("trainer.steps=400", "trainer.steps_per_round=200", "reference.steps=5", "reference.first_steps=5"),
    *("agent.update_ratio=.01", "env.evaluation_episodes=1"),
)


def run(output: Path, *words: str) -> Path:
    """The folder of the runs of a job."""
    return credit.run([*words, f"output={output}"]).folders[0].parent


@pytest.fixture(scope="module")
def advertiser(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("advertiser"), *SHORT, "replicas=2")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_row_a_step_and_the_label_in_a_windows_last_row(advertiser: Path, ending: str, tmp_path: Path) -> None:
    file = credit.export(advertiser / "seed-0", tmp_path / f"data.{ending}")
    frame = (pd.read_csv if ending == "csv" else pd.read_parquet)(file)
    arrays = credit.load(advertiser / "seed-0").recovery
    assert arrays is not None
    assert [*frame] == ["episode", "step", "observation", "action", "next_observation", "window", "label"]
    assert frame["observation"].tolist() == arrays["windows/states"].ravel().tolist()
    assert frame["next_observation"].tolist() == arrays["windows/next_states"].ravel().tolist()
    assert frame["window"].tolist() == np.repeat(np.arange(10), 7).tolist()
    assert frame["label"].notna().sum() == 10
    np.testing.assert_array_equal(frame["label"][6::7], arrays["windows/labels"])


def test_all_seeds_lie_in_one_table(advertiser: Path) -> None:
    both = learned(advertiser)
    assert both.words["group"] == "seed"
    assert both.frame["seed"].tolist() == [0] * 70 + [1] * 70
    assert both.words["sizes"] == {"observation": 10, "action": 3}


def test_windows_are_episodes_and_may_end_early(tmp_path: Path) -> None:
    place = run(tmp_path, "experiment=sepsis", "method=reference", "trainer.steps=100", "tracking=none") / "seed-0"
    frame = learned(place).frame
    assert (frame["episode"] == frame["window"]).all()
    assert (frame.groupby("window")["step"].max() + 1 == frame.groupby("window").size()).all()
    assert frame.groupby("window")["label"].count().eq(1).all()


def test_steps_of_vectors_are_there_where_they_were_kept_and_another_run_starts_from_them(tmp_path: Path) -> None:
    bare = run(tmp_path / "bare", *CARTPOLE) / "seed-0"
    with pytest.raises(UserError, match=r"keep=\[steps\]"):
        credit.export(bare, tmp_path / "data.csv")
    assert not (tmp_path / "data.csv").exists()
    kept = run(tmp_path / "kept", *CARTPOLE, "keep=[steps]") / "seed-0"
    assert learned(kept).words["states"] == [f"observation_{i}" for i in range(4)]
    file = credit.export(kept, tmp_path / "data.csv")
    begun = run(tmp_path / "begun", *CARTPOLE, f"demonstrations_from={file}") / "seed-0"
    assert (begun / "DONE").exists()


def test_a_policy_has_no_effect_on_a_table(advertiser: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="policy=greedy has no effect"):
        credit.export(advertiser, tmp_path / "data.csv", policy="greedy")

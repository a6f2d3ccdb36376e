"""`credit recover RUN`: the windows of a finished run, from its folder alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import credit
from credit.cli.main import main
from credit.cli.recovery_data import resolved
from credit.core.errors import UserError
from credit.logged.result import LoggedCredit
from credit.logged.tables.opening import opened

QUICK = ("draws=15", "tracking=none")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("runs")
    words = ["trainer.steps=210", "method=reference", "tracking=none", "replicas=2", f"output={output}"]
    return credit.run(words).folders[0].parent


def test_a_run_says_itself_what_its_columns_are(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["recover", str(run / "seed-0"), *QUICK]) == 0
    shown = capsys.readouterr().out
    for words in ("210 rows, 30 windows", "actions  action", "states   observation", "adaptive collection"):
        assert words in " ".join(shown.split()) or words in shown
    folder = Path("outputs/recover/advertiser-reference-trainer.steps-210-seed-0")
    assert len(pd.read_parquet(folder / "steps.parquet")) == 210
    windows = pd.read_csv(folder / "windows.csv")
    arrays = credit.load(run / "seed-0").recovery
    assert arrays is not None
    np.testing.assert_allclose(windows["label"], arrays["windows/labels"])


def test_seeds_are_groups_and_words_count_more(run: Path) -> None:
    both = credit.recover(run, draws=15, states=[], surrogates={})
    assert both.found.panel.roles.group == "seed"
    assert both.found.panel.roles.states == ()
    assert {*both.effects["action"]} == {"action"}


def test_a_folder_without_a_finished_run_is_refused(run: Path, tmp_path: Path) -> None:
    (tmp_path / "config.yaml").touch()
    with pytest.raises(UserError, match="no finished run"):
        credit.recover(tmp_path)


def same(one: LoggedCredit, other: LoggedCredit) -> None:
    assert one.found.panel.roles == other.found.panel.roles
    assert one.found.panel.columns == other.found.panel.columns
    for name in ("steps", "windows", "effects"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(other, name), rtol=1e-9, check_dtype=False)
    assert any("adaptive collection" in sentence for sentence in other.said)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("seed", ["seed-0", ""])
def test_what_was_exported_is_read_as_the_run_is(run: Path, ending: str, seed: str, tmp_path: Path) -> None:
    file = credit.export(run / seed, tmp_path / f"data.{ending}")
    whole = credit.recover(run / seed, draws=15)
    same(whole, credit.recover(file, draws=15))
    assert whole.found.panel.roles.sizes == {"observation": 10, "action": 3}
    some = credit.recover(file, draws=15, states=[], surrogates={})
    assert some.found.panel.roles.group == (None if seed else "seed")
    assert (some.found.panel.roles.states, some.found.panel.roles.next_states) == ((), ())


def test_vectors_and_large_files_are_read_as_the_run_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["env=gymnasium", "env.id=CartPole-v1", "method=reference", "feedback=block_sum", "tracking=none",
             "replicas=1", "trainer.steps=400", "trainer.steps_per_round=200", "reference.steps=5",
             "reference.first_steps=5", "agent.update_ratio=.01", "env.evaluation_episodes=1",
             "keep=[steps]"]  # fmt: skip
    place = credit.run([*words, f"output={tmp_path}"]).folders[0]
    table, given = resolved(place, {})
    whole = opened(table, given)
    for ending in ("csv", "parquet"):
        file = credit.export(place, tmp_path / f"data.{ending}")
        for memory in (2**29, 100):
            panel = opened(file, memory=memory)
            assert panel.roles == whole.roles
            assert (panel.columns["action"].levels, panel.roles.sizes) == ((0, 1), {"action": 2})
            np.testing.assert_array_equal(panel.windows.label, whole.windows.label)


def test_a_mean_is_said_by_parquet_and_asked_for_by_csv(tmp_path: Path) -> None:
    words = ["trainer.steps=70", "method=reference", "tracking=none", "replicas=1", "feedback=mean"]
    place = credit.run([*words, f"output={tmp_path}"]).folders[0]
    panel = opened(credit.export(place, tmp_path / "data.parquet"))
    assert panel.roles.label_is == "mean"
    panel = opened(credit.export(place, tmp_path / "data.csv"))
    assert panel.roles.label_is == "sum"
    assert any("whether a label is a sum, a mean or the last reward" in one for one in panel.said)
    frame = pd.read_csv(tmp_path / "data.csv").assign(more=0.5)
    assert not any("credit export" in one for one in opened(frame).said)

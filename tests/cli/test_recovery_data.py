"""`credit recover RUN`: the windows of a finished run, from its folder alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import credit
from credit.cli.main import main
from credit.core.errors import UserError

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

"""Registered reward models on the command line of `credit recover`."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from credit.cli.main import main
from credit.cli.recovery_parts import models_of
from credit.logged.registered import Chosen
from credit.recovery.mixers import Best, RelativeMSE
from credit.recovery.models.neural import NeuralModel
from credit.recovery.uncertainty.networks import Ensemble
from tests.logged.test_registered import cells

WORDS = ("data.window=w", "data.label=y", "data.states=[s]", "data.actions=[a]", "data.time=false", "data.group=false",
         "draws=15", "tracking=none")  # fmt: skip


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    cells(60).drop(columns="worth").to_csv("log.csv", index=False)
    return Path("log.csv")


def recover(*words: str) -> int:
    return main(["recover", "log.csv", *WORDS, *words])


def test_options_and_formulas_go_together(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("reference=ridge", "reference.regularization=.001", "surrogates.line=linear", "surrogates.s.formula=1 + s")
    assert recover(*words) == 0
    steps = pd.read_csv("outputs/recover/log/steps.csv")
    assert {"credit_reference", "credit_line", "credit_s", "weight_line"} <= {*steps}
    shown = " ".join(capsys.readouterr().out.split())
    assert "LinearModel 'ridge': a state is one of 3, an action one of 2" in shown
    assert "0.001" not in shown
    summary = json.loads(Path("outputs/recover/log/summary.json").read_text())
    assert "lambda_s" in summary["metrics"]
    assert "lambda_reference" not in summary["metrics"]


def test_registered_models_score_rows_again(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    network = ("surrogates.net=dnn", "surrogates.net.width=4", "surrogates.net.first_steps=3", "folds=2")
    assert recover("reference=ridge", "surrogates.s.formula=1 + s", *network) == 0
    assert main(["recover", "log.csv", "--model", "outputs/recover/log", "name=again", "tracking=none"]) == 0
    one, two = (pd.read_csv(f"outputs/recover/{name}/steps.csv") for name in ("log", "again"))
    pd.testing.assert_frame_equal(one, two, rtol=1e-6)
    path = Path("outputs/recover/log/model/model.json")
    path.write_text(path.read_text().replace("credit.recovery.models.linear.LinearModel", "shutil.rmtree"))
    capsys.readouterr()
    assert main(["recover", "log.csv", "--model", "outputs/recover/log", "name=other", "tracking=none"]) == 2
    assert "'shutil.rmtree' is no registered part" in capsys.readouterr().err


def test_a_uncertainty_brings_its_draws(log: Path) -> None:
    words = [word for word in WORDS if not word.startswith("draws")]
    assert main(["recover", "log.csv", *words, "reference=ridge", "uncertainty=bootstrap", "uncertainty.draws=13"]) == 0
    said = json.loads(Path("outputs/recover/log/summary.json").read_text())["said"]
    assert any("by the uncertainty that was named" in sentence for sentence in said)


def test_several_models_are_several_recoveries(log: Path) -> None:
    assert recover("-m", "reference=ridge,1 + s", "surrogates={}") == 0
    assert len(list(Path("outputs/recover/log-sweep").iterdir())) == 2


def test_a_file_of_ones_own_is_an_option(log: Path) -> None:
    Path("own/reward").mkdir(parents=True)
    Path("own/reward/mine.yaml").write_text("defaults: [ridge, _self_]\nname: mine\nregularization: 2.0\n")
    assert recover("reference=mine", "--config-dir=own") == 0
    assert models_of({"reference": "mine"}, ["own"]).reference.node["regularization"] == 2.0


def test_what_is_asked_is_composed_as_for_a_run() -> None:
    plain = models_of({"reference": {"": "dnn", "width": 16}}, [])
    assert isinstance(plain.reference, Chosen)
    assert isinstance(plain.reference.model, NeuralModel)
    assert (plain.reference.model.width, plain.reference.model.standardise, plain.reference.own) == (16, True, False)
    assert plain.surrogates is None
    own = models_of({"reference": "dnn", "uncertainty": "ensemble", "mixer": "best"}, [])
    assert isinstance(own.reference.model.uncertainty, Ensemble)
    assert own.reference.own
    assert isinstance(own.mixer, Best)
    whole = models_of({"experiment": "advertiser", "surrogates": {"linear": {"regularization": 3.0}}}, [])
    assert whole.surrogates is not None
    assert {*whole.surrogates} == {"linear", "threshold"}
    assert whole.surrogates["linear"].node["regularization"] == 3.0
    assert isinstance(whole.mixer, RelativeMSE)
    assert whole.draws == 20
    other = models_of({"experiment": "advertiser", "surrogates": {"linear": "threshold", "mine": "1 + s"}}, [])
    assert other.surrogates is not None
    assert other.surrogates["linear"].model.name == "threshold"
    assert other.surrogates["mine"] == "1 + s"
    assert models_of({"experiment": "advertiser", "surrogates": {}}, []).surrogates == {}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("reference.option=dnnn",), "did you mean 'dnn'"),
        (("reference=dnn", "reference.widht=3"), "did you mean 'width'"),
        (("reference=ridge", "reference.regularization=-1"), "regularization"),
        (("reference=ridge", "uncertainty=ensemble"), "none of the models (LinearModel) takes Ensemble"),
        (("uncertainty=ensemble",), "uncertainty has no effect"),
        (("reference=ridge", "uncertainty=analytic"), "makes no draws"),
        (("reference=ridge", "uncertainty=bootstrap"), "set draws=20"),
        (("reference=primitive",), "is shown the reward of every step"),
        (("reference=maze_cells",), "Maze"),
        (("reference=clinical",), "knows patients"),
        (("experiment=advertizer",), "did you mean 'advertiser'"),
        (("reference=ridge", "data.label_is=binary"), "allows 0 and 1"),
    ],
)
def test_bad_input_is_refused_and_nothing_is_made(
    log: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert recover(*words) == 2
    assert said in capsys.readouterr().err
    assert not Path("outputs").exists()

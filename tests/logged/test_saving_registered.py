"""Registered models in a model's folder: the fit's own steps come back, and nothing but what is registered is made."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import credit
from credit.core.errors import UserError
from credit.core.seams import RewardModel
from credit.logged.registered import Chosen
from credit.logged.result import LoggedCredit
from credit.logged.saving import SavedModel
from credit.networks.modules import Module, Perceptron
from credit.recovery.features.cells import EqualCells
from credit.recovery.features.flat import Flat
from credit.recovery.features.formula import Formula
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.neural import NeuralModel
from credit.recovery.models.table import TableModel
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.recovery.uncertainty.networks import Dropout, LastLayer
from tests.logged.test_recovering import found, table
from tests.logged.test_registered import cells, network, recovered

SCALE = 1e-6  # of the largest credit, for single precision


def quick(uncertainty: Any = None, **keys: Any) -> NeuralModel:
    return network(uncertainty, **{"first_steps": 5, "batch": 8, **keys})


def again(one: LoggedCredit, folder: Path) -> SavedModel:
    one.model.write(folder / "model")
    return credit.load_model(folder)


def require_same(model: SavedModel, one: LoggedCredit, frame: pd.DataFrame, within: float) -> None:
    new = model.predict(frame)
    numbers = one.steps.select_dtypes("number").columns
    scale = one.steps["credit"].abs().max()
    assert [*new] == [*one.steps]
    np.testing.assert_allclose(new[numbers], one.steps[numbers], rtol=within, atol=within * scale)
    assert new["credit_low"].notna().all()


@pytest.mark.parametrize(
    ("reference", "own"),
    [
        (lambda: quick(), False),
        (lambda: quick(), True),
        (lambda: quick(Dropout(passes=3)), True),
        (lambda: quick(LastLayer()), True),
        (lambda: quick(network=Perceptron([4])), True),
    ],
)
def test_networks_come_back(tmp_path: Path, reference: Callable[[], NeuralModel], own: bool) -> None:
    frame = table(windows=12, groups=2).assign(c=np.tile([*"ab"], 60))
    surrogates = {"x": "1 + x", "line": LinearModel("line", Flat())}
    one = found(frame, states=["z", "c"], reference=Chosen(reference(), own), surrogates=surrogates, draws=10, folds=2)
    require_same(again(one, tmp_path), one, frame, SCALE)


@pytest.mark.parametrize(
    "model",
    [
        LinearModel("ridge", Identity()),
        LinearModel("ridge", Identity(["state", "step"]), credit="every_step"),
        LinearModel("boot", Bilinear(), Bootstrap(draws=10)),
        TableModel(Bootstrap(draws=10)),
    ],
)
@pytest.mark.parametrize("label_is", ["sum", "last"])
def test_models_of_double_precision_come_back(tmp_path: Path, model: RewardModel, label_is: str) -> None:
    frame = cells(30)
    surrogates = {"s": "1 + s", "steps": LinearModel("steps", Identity(["state", "action", "step"]))}
    one = recovered(frame, model, surrogates=surrogates, draws=10, folds=2, label_is=label_is)
    require_same(again(one, tmp_path), one, frame, 1e-12)


def test_bits_and_a_formula_as_the_reference_come_back(tmp_path: Path) -> None:
    frame = cells(60)
    frame["y"] = np.where(frame["y"].notna(), frame["y"] > frame["y"].median(), np.nan)
    logistic = LinearModel("ridge", Identity(), likelihood="logistic")
    one = recovered(frame, "1 + s + a", label_is="binary", surrogates={"cells": logistic}, draws=10, folds=2)
    model = again(one, tmp_path)
    new = model.scored(frame.drop(columns="worth"))
    for name in ("credit", "credit_low", "credit_cells", "weight_cells", "disagreement"):
        np.testing.assert_allclose(new.steps[name], one.steps[name], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(new.windows["predicted"], one.windows["predicted"], rtol=1e-12)


def test_rows_that_were_not_fitted_are_scored_as_by_the_fit_itself(tmp_path: Path) -> None:
    frame = table(windows=12)
    one = found(frame, reference=quick(), draws=2, folds=2, surrogates={"x": "1 + x"})
    new = table(windows=5, seed=3).drop(columns=["y", "w"])
    pd.testing.assert_frame_equal(again(one, tmp_path).predict(new), one.predict(new), rtol=SCALE)


def test_longer_windows_than_were_fitted_have_no_step(tmp_path: Path) -> None:
    one = recovered(cells(20), LinearModel("steps", Identity(["state", "action", "step"])), draws=2, folds=2)
    with pytest.raises(UserError, match="a window has 6 rows, and 4 at most"):
        again(one, tmp_path).predict(cells(20, 6).drop(columns="worth"))


def test_the_configuration_says_what_objects_do_not(tmp_path: Path) -> None:
    """EqualCells keeps `actions` under another name: from a configuration it is saved, as an object it is not."""
    frame = table(windows=12)
    features = EqualCells({"z": 3, "a0": 2}, {"z": [-3, 3]}, actions=False)
    node = {"_target_": "", "name": "cut", "features": {"_target_": "", "cells": {"z": 3, "a0": 2},
            "bounds": {"z": [-3, 3]}, "actions": False}}  # fmt: skip
    words: dict[str, Any] = {"surrogates": {}, "draws": 10, "folds": 2}
    one = found(frame, reference=Chosen(LinearModel("cut", features), False, node), **words)
    require_same(again(one, tmp_path), one, frame, 1e-12)
    assert "'actions'" in found(frame, reference=LinearModel("cut", features), **words).found.models[0].unsaved


class Own(LinearModel):
    """A model that no YAML file names."""


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (Own("own", Formula("1 + z")), "no YAML file of credit"),
        (quick(network=Module("torch.nn:Linear")), "Module is not saved"),
    ],
)
def test_what_cannot_be_saved_says_so_before_it_is_fitted(tmp_path: Path, model: RewardModel, said: str) -> None:
    one = found(table(windows=12), reference=model, surrogates={}, draws=2, folds=2)
    assert said in one.found.models[0].unsaved
    assert said in one.found.fitted.unsaved
    with pytest.raises(UserError, match=said):
        one.model.write(tmp_path / "model")


def test_a_state_of_something_else_is_not_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LinearModel, "acting", lambda self: {"features": Formula})
    one = found(table(windows=12), reference=LinearModel("ridge", Flat()), surrogates={}, draws=2, folds=2)
    assert "holds a ABCMeta" in one.found.fitted.unsaved


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("written")
    one = found(table(windows=12), reference=quick(), surrogates={}, draws=2, folds=2)
    one.model.write(folder / "model")
    return {path.name: path.read_bytes() for path in (folder / "model").iterdir()}


def first(whole: dict[str, Any]) -> dict[str, Any]:
    one: dict[str, Any] = whole["models"][0]
    return one


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: one["node"].update(_target_="os.system"), "'os.system' is no registered part"),
        (lambda one: one["node"].update(_target_="tests.logged.nothing.Model"), "is no registered part"),
        (lambda one: one["node"]["features"].update(_target_="credit.networks.modules.Module"), "no registered part"),
        (lambda one: one["node"].update(one["node"]["features"]), "is no RewardModel"),
        (lambda one: one["node"].update(network={"_target_": "credit.networks.modules.Module"}), "no registered"),
        (lambda one: one["node"].update(features="Flat"), "'Flat' is no registered part"),
        (lambda one: one["node"].update(widht=3), "did you mean 'width'"),
        (lambda one: one["node"].update(width=-3), "width"),
        (lambda one: one["node"].update(width=9), "the model reference"),
        (lambda one: one["node"].update(depth=3), "the model reference"),
        (lambda one: one.pop("node"), "no 'node'"),
        (lambda one: one["fit"].update(draws=7), "reference"),
        (lambda one: one["fit"].update(models=[]), "the model reference"),
        (lambda one: one["fit"]["models"][0].update(seeds=[1]), "the model reference"),
        (lambda one: one["fit"]["models"][0].update(state={"dict": {}, "more": 1}), "the model reference"),
        (lambda one: one["fit"]["models"][0].update(state={"pickle": "gASV"}), "'pickle' is no part of a state"),
    ],
)
def test_what_is_damaged_or_foreign_is_named(
    tmp_path: Path, written: dict[str, bytes], change: Callable[[dict[str, Any]], Any], said: str
) -> None:
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
    whole = json.loads(written["model.json"])
    change(first(whole))
    (tmp_path / "model.json").write_text(json.dumps(whole))
    with pytest.raises(UserError, match=said) as error:
        credit.load_model(tmp_path)
    assert "model.json" in str(error.value)


def test_a_model_that_predicts_otherwise_here_is_refused(
    tmp_path: Path, written: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
    believed = NeuralModel.believe
    monkeypatch.setattr(NeuralModel, "believe", lambda self, steps: (own := believed(self, steps), own.mean.add_(1))[0])
    with pytest.raises(UserError, match="does not predict what it did"):
        credit.load_model(tmp_path)


def test_no_array_is_an_object_and_states_are_small(tmp_path: Path, written: dict[str, bytes]) -> None:
    (tmp_path / "fits.npz").write_bytes(written["fits.npz"])
    with np.load(tmp_path / "fits.npz", allow_pickle=False) as arrays:
        assert {values.dtype.kind for values in arrays.values()} <= {"f", "i", "b"}
        weights = sum(values.size for name, values in arrays.items() if values.dtype == np.float32)
    assert weights < 3 * 3 * (8 * 2 + 8 * 8 + 8 + 2 * 8 + 1)  # three networks, without what trained them

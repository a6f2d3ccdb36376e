"""Registered reward models in the place of formulas: the same files, the same draws, and what cannot be is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

import credit
from credit.core.errors import UserError
from credit.logged.fits import registered as fits
from credit.logged.fits.units import Units
from credit.logged.fits.weighing import times
from credit.logged.result import LoggedCredit
from credit.recovery.features.flat import Flat
from credit.recovery.features.formula import Formula
from credit.recovery.features.tabular import Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.neural import NeuralModel
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.recovery.uncertainty.networks import Ensemble
from tests.logged.test_recovering import found, table

CELLS: dict[str, Any] = {"window": "w", "label": "y", "states": ["s"], "actions": ["a"], "time": False, "group": False}


def cells(windows: int = 150, length: int = 4, seed: int = 0) -> pd.DataFrame:
    """Rows with a state 0 to 2 and an action 0 or 1; in a window's last row a label Σ s − 2 a + 3 s a, with noise."""
    random = np.random.default_rng(seed)
    count = windows * length
    state, action = random.integers(0, 3, count), random.integers(0, 2, count)
    worth = state - 2.0 * action + 3 * state * action
    label = worth.reshape(windows, length).sum(1) + 0.2 * random.normal(size=windows)
    last = np.arange(count) % length == length - 1
    return pd.DataFrame(
        {
            "w": np.repeat(np.arange(windows), length), "s": state, "a": action,
            "y": np.where(last, np.repeat(label, length), np.nan), "worth": worth,
        }
    )  # fmt: skip


def network(uncertainty: Any = None, **keys: Any) -> NeuralModel:
    small = {
        "width": 8,
        "first_steps": 150,
        "stride": None,
        "balance": "none",
        "standardise": True,
        "learning_rate": 1e-2,
    }
    return NeuralModel("net", Flat(), uncertainty or Ensemble(members=2, prior_scale=0.1), **{**small, **keys})


def recovered(frame: pd.DataFrame, reference: Any, **words: Any) -> LoggedCredit:
    return credit.recover(
        frame.drop(columns="worth", errors="ignore"),
        reference=reference,
        **{**CELLS, "draws": 30, "surrogates": {}, **words},
    )


def test_a_table_is_recovered_and_its_draws_are_those_of_formulas() -> None:
    frame = cells()
    ridge = LinearModel("ridge", Identity(), regularization=1e-6)
    one = recovered(frame, ridge, surrogates={"cells": {"formula": "0 + C(s):C(a)", "regularization": 0}})
    np.testing.assert_allclose(one.steps["credit_reference"], frame["worth"], atol=0.2)
    np.testing.assert_allclose(one.steps["credit_reference"], one.steps["credit_cells"], atol=1e-4)
    assert one.steps["disagreement"].max() < 0.1  # of the same fits, draw by draw: their gap is none
    assert one.r_squared["reference"][0] > 0.9
    per_unit = one.effects.set_index("model")["per_unit"]
    np.testing.assert_allclose(per_unit["reference"], per_unit["cells"], rtol=1e-4)
    intervals = one.effects.set_index("model")[["per_unit_low", "per_unit_high"]]
    np.testing.assert_allclose(intervals.loc["reference"], intervals.loc["cells"], rtol=1e-3)


@pytest.mark.parametrize("own", [True, False])
def test_a_network_finds_what_made_the_labels(own: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own uncertainty, or refits to units that are drawn again: as an object has it, or none is asked for."""
    from credit.logged.registered import Chosen

    monkeypatch.setattr(fits, "REPLICATED", 20_000)  # some replicas at a time
    frame = table(windows=80)
    one = found(frame, reference=Chosen(network(), own), surrogates={"x": "1 + x"}, draws=10, folds=2)
    truth = 2 + 3 * frame["x"] - frame["z"]
    assert np.corrcoef(one.steps["credit_reference"], truth)[0, 1] > 0.98
    assert (one.steps["credit_low"] < one.steps["credit_high"]).all()
    assert {*one.effects["model"]} == {"reference", "x", "mixture"}
    assert one.effects.set_index("model")["per_unit"]["reference"] == pytest.approx(
        3, abs=0.7
    )  # a small network levels
    assert one.told["told"].eq("yes").all()  # by the linear design of all columns
    assert one.r_squared["reference"][0] > 0.9
    np.testing.assert_allclose(
        one.steps.groupby([frame["g"], frame["w"]])["credit_balanced"].sum(), frame.groupby(["g", "w"])["y"].first()
    )


def test_the_same_call_gives_the_same_numbers() -> None:
    frame = table(windows=30)
    one, again = (found(frame, reference=network(first_steps=20), surrogates={}, draws=3, folds=2) for _ in range(2))
    pd.testing.assert_frame_equal(one.steps, again.steps)


@pytest.mark.parametrize("label_is", ["mean", "last"])
def test_labels_may_be_means_or_the_last_row(label_is: str) -> None:
    frame = cells(300)
    worth = frame["worth"].to_numpy().reshape(-1, 4)
    label = worth.mean(1) if label_is == "mean" else worth[:, -1]
    frame["y"] = np.where(frame["y"].notna(), np.repeat(label, 4), np.nan)
    one = recovered(frame, LinearModel("ridge", Identity(), regularization=1e-6), label_is=label_is)
    np.testing.assert_allclose(one.steps["credit"], frame["worth"], atol=0.01)


def test_bits_are_log_odds() -> None:
    random = np.random.default_rng(0)
    frame = cells(900, 3)
    sums = 0.5 * frame["worth"].to_numpy().reshape(-1, 3).sum(1) - 2
    bits = (random.uniform(size=900) < 1 / (1 + np.exp(-sums))).astype(float)
    frame["y"] = np.where(frame["y"].notna(), np.repeat(bits, 3), np.nan)
    model = LinearModel("ridge", Identity(), regularization=0.01, likelihood="logistic")
    one = recovered(frame, model, surrogates={"s": "1 + s"}, draws=5, folds=2)
    difference = one.steps["credit_reference"] - 0.5 * frame["worth"]
    assert difference.std() < 0.4
    assert one.r_squared["reference"][0] > one.r_squared["s"][0] > 0
    assert one.windows["predicted"].between(0, 1).all()
    assert one.windows["held_out"].between(0, 1).all()


def test_windows_without_a_label_get_a_prediction_and_may_differ_in_length() -> None:
    frame = cells(80).drop(index=[1, 2, 9])
    frame.loc[frame["w"].isin([3, 40]), "y"] = np.nan
    for reference in (LinearModel("ridge", Identity()), LinearModel("ridge", Identity(), Bootstrap(draws=30))):
        one = recovered(frame, reference)
        assert one.windows["predicted"].notna().all()
        np.testing.assert_allclose(one.steps["credit"], frame["worth"], atol=0.6)


def test_what_a_state_leads_to_is_looked_at_where_the_table_says_it() -> None:
    frame = cells()
    frame["next_s"] = np.random.default_rng(1).integers(0, 3, len(frame))
    by_window = frame["next_s"].to_numpy().reshape(-1, 4).sum(1).repeat(4)
    frame["y"] = np.where(frame["y"].notna(), by_window, np.nan)
    one = recovered(frame, LinearModel("ridge", Identity(["next_state"]), regularization=1e-6))
    np.testing.assert_allclose(one.steps["credit"], frame["next_s"], atol=1e-3)
    with pytest.raises(UserError, match="looks at the state behind a step"):
        recovered(frame.drop(columns="next_s"), LinearModel("ridge", Identity(["next_state"])))


def test_categories_are_cells_or_zeros_and_ones() -> None:
    frame = cells()
    words = frame.assign(s=np.array([*"pqr"])[frame["s"]], a=np.array([*"uv"])[frame["a"]])
    one, two = (recovered(rows, LinearModel("ridge", Identity())) for rows in (frame, words))
    np.testing.assert_allclose(one.steps["credit"], two.steps["credit"])
    assert two.policies is not None  # all states and actions are finite
    assert len(two.policies.table) == 3
    flat = LinearModel("flat", Flat(), regularization=1e-6)
    more = recovered(words.assign(t=frame["s"] / 2 + 0.3), flat, states=["s", "t"])
    assert more.found.models[0].terms.names[:4] == ("s=p", "s=q", "s=r", "t")


def test_coordinates_have_the_names_of_columns() -> None:
    one = found(table(), reference=LinearModel("named", Formula("1 + z + a0"), regularization=1e-6), surrogates={})
    assert np.corrcoef(one.steps["credit"], 2 + 3 * table()["x"] - table()["z"])[0, 1] > 0.999


@pytest.mark.parametrize(
    ("model", "words", "said"),
    [
        (LinearModel("ridge", Identity(), Bootstrap(draws=7)), {}, "set draws=7"),
        (LinearModel("ridge", Identity(), likelihood="logistic"), {}, "likelihood=logistic"),
        (LinearModel("ridge", Identity(), credit="last_step"), {}, "data.label_is=last"),
        (LinearModel("ridge", Identity()), {"states": ["s", "z"]}, "both whole numbers"),
        (LinearModel("ridge", Identity()), {"sizes": {"s": 2}}, "data.sizes says 0 to 1"),
        (LinearModel("ridge", Identity()), {"sizes": {"q": 2}}, "which is no feature"),
        (LinearModel("own", Formula("1 + q")), {}, "no coordinate 'q'"),
        (network(likelihood="logistic"), {}, "likelihood=logistic"),
        (3, {}, "a registered reward model"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_fitted(
    model: Any, words: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("credit.logged.recovering._Fit.__init__", None)
    with pytest.raises(UserError, match=said):
        recovered(cells().assign(z=0.5 * cells()["s"]), model, **words)


def test_large_tables_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fits, "LARGEST", 100)
    with pytest.raises(UserError, match="use formulas, which read a table in parts"):
        recovered(cells(), LinearModel("ridge", Identity()))


def test_an_uncertainty_without_draws_gives_way_to_units() -> None:
    one = recovered(cells(), LinearModel("ridge", Identity(), Analytic()))
    assert (one.steps["credit_high"] > one.steps["credit_low"]).all()


def test_units_are_drawn_as_often_as_they_are_weighed() -> None:
    units = Units("blocks", np.arange(400), np.arange(400, dtype=np.uint64), 1, 0.0, 0.0, "")
    often, weights = times(units, units.of, 50, 0), units.weights(units.of, 50, 0)
    assert (often[:, 0] == 1).all()
    assert often[:, 1:].mean() == pytest.approx(1, abs=0.02)
    assert often[:, 1:].var() == pytest.approx(1, abs=0.05)
    assert np.corrcoef(often[:, 1:].ravel(), weights[:, 1:].ravel())[0, 1] > 0.9

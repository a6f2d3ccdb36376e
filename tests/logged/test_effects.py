"""Effects against coefficients and sums written out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from credit.logged.fits.mixture import mixed
from credit.recovery.mixers import RelativeMSE
from tests.logged.test_recovering import found, table


def test_an_effect_of_a_linear_model_is_its_coefficient_counted_from_the_baseline() -> None:
    frame = table(groups=3).assign(spent=1.0)
    frame["spent"] = 2 * frame["x"]
    one = found(frame, surrogates={}, baseline={"x": 0.5}, cost={"x": "spent"})
    line = one.effects.iloc[0]
    theta = one.found.fits[0].theta[:, 1]
    assert one.found.models[0].terms.names[1] == "x"
    np.testing.assert_allclose(line["per_unit"], theta[0], rtol=1e-9)
    np.testing.assert_allclose(line["effect"], theta[0] * (frame["x"] - 0.5).mean(), rtol=1e-9)
    np.testing.assert_allclose(line["total"], theta[0] * (frame["x"] - 0.5).sum(), rtol=1e-9)
    assert np.isnan(line["per_cost"])  # what half a unit would have cost is not known
    assert (
        "there is no number per cost of x: its baseline is 0.5, and what that would have cost is not known" in one.said
    )
    one = found(frame, surrogates={}, cost={"x": "spent"})
    other = one.effects.iloc[0]
    np.testing.assert_allclose(other["per_cost"], other["total"] / frame["spent"].sum(), rtol=1e-9)
    assert not any("per cost" in sentence for sentence in one.said)
    half = one.found.factor * theta[1:].std()
    np.testing.assert_allclose([line["per_unit_low"], line["per_unit_high"]], [theta[0] - half, theta[0] + half])


@pytest.mark.parametrize("rows", [10**9, 50])
def test_the_effect_of_a_mixture_is_what_it_says_of_all_rows(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("credit.logged.effects.ROWS", rows)
    frame = table(groups=3)
    one = found(frame, surrogates={"x": "1 + x"})
    thetas = [fit.theta for fit in one.found.fits]

    def of(x: pd.Series) -> np.ndarray:
        ones = np.ones(len(frame))
        designs = [np.column_stack([ones, x, frame["z"]]), np.column_stack([ones, x])]
        what = mixed(designs, thetas, RelativeMSE(), keep=True)
        return np.concatenate([what.credit[None], what.draws])

    wanted = (of(frame["x"]) - of(frame["x"] * 0)).mean(1)
    line = one.effects.set_index("model").loc["mixture"]
    within = {"rtol": 1e-9} if rows > len(frame) else {"rtol": 0.1}  # of a sample
    np.testing.assert_allclose(line["effect"], wanted[0], **within)
    half = one.found.factor * wanted[1:].std()
    np.testing.assert_allclose(line["effect_high"] - line["effect"], half, rtol=within["rtol"] * 5)


def test_each_category_has_an_effect_in_its_own_rows() -> None:
    frame = table(groups=3)
    kinds = np.random.default_rng(1).choice(["none", "a", "b"], p=[0.6, 0.2, 0.2], size=len(frame))
    frame["x"] = kinds
    worth = pd.Series(kinds).map({"none": 0.0, "a": 2.0, "b": -1.0})
    frame["y"] = worth.groupby([frame["g"], frame["w"]]).transform("sum") + 1
    one = found(frame, surrogates={}, rho=0.0, reference={"formula": "1 + x + z", "regularization": 0})
    effects = one.effects.set_index("level")
    assert set(effects["baseline"]) == {"none"}
    np.testing.assert_allclose(effects.loc[["a", "b"], "effect"], [2, -1], atol=1e-6)
    assert effects.loc["a", "rows"] == (kinds == "a").sum()


@pytest.mark.parametrize("fixed", [0.0, 0.5])
def test_a_category_has_a_number_per_cost_where_its_baseline_costs_nothing(fixed: float) -> None:
    frame = table()
    frame["kind"] = np.random.default_rng(1).choice(["none", "a"], p=[0.6, 0.4], size=len(frame))
    frame["spent"] = np.where(frame["kind"] == "a", 3.0, fixed)
    words = {"reference": "1 + kind + x", "surrogates": {}, "actions": ["kind"], "states": ["x"]}
    one = found(frame, cost={"kind": "spent"}, **words)
    line = one.effects.iloc[0]
    said = [sentence for sentence in one.said if "per cost" in sentence]
    if fixed:
        cost = fixed * (frame["kind"] == "none").sum()
        assert said == [
            f"there is no number per cost of kind: its baseline is 'none', and rows with it cost {cost:.6g}"
        ]
        assert np.isnan(line["per_cost"])
    else:
        assert said == []
        np.testing.assert_allclose(line["per_cost"], line["total"] / (3.0 * line["rows"]))


def test_an_action_that_never_moved_has_no_unit() -> None:
    frame = table(groups=2)
    frame.loc[:, "x"] = 0.0
    one = found(frame, surrogates={}, reference="1 + z + x")
    line = one.effects.iloc[0]
    assert np.isnan(line["per_unit"])
    assert line["note"] == "x is 0.0 in every row"


def test_a_sign_that_holds_a_number_at_0_is_said() -> None:
    frame = table().assign(v=lambda rows: rows["x"] * 0.1 + np.random.default_rng(5).normal(size=len(rows)))
    asked = {"formula": "1 + x + z + v", "sign": {"x": "negative", "v": "positive"}}
    one = found(frame, actions=["x", "v"], reference=asked, surrogates={"x": "1 + x + z"})
    notes = one.effects.set_index(["action", "model"])["note"]
    assert notes["x", "reference"] == "held at 0 by its sign (negative)"
    assert notes["x", "x"] == notes["v", "reference"] == ""
    told = one.told.set_index("column")["note"]
    assert told["x"] == notes["x", "reference"]
    assert told["z"] == ""
    assert "never moved" not in one.report()


def test_a_coefficient_of_a_decay_that_draws_choose_has_a_note() -> None:
    one = found(table(noise=3.0), reference="1 + adstock(x) + z", surrogates={}, draws=30)
    notes = one.told.set_index("column")["note"]
    assert [note for note in notes if note] == [
        "adstock(x) has other numbers in other draws: see effects.csv for what it was worth"
    ]
    assert notes["z"] == ""

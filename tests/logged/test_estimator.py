"""The estimator: what scikit-learn asks of one, and that it is the same recovery."""

from __future__ import annotations

import doctest
import pickle
from typing import Any

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from credit import CreditRegressor
from credit.core.errors import UserError
from credit.logged import estimator as module
from tests.logged.test_recovering import found, table


@parametrize_with_checks([CreditRegressor(), CreditRegressor(regularization=0.1, surrogates={"one": "1"}, draws=5)])
def test_what_scikit_learn_asks_of_an_estimator(estimator: Any, check: Any) -> None:
    check(estimator)


def test_it_is_the_recovery_of_a_table() -> None:
    frame = table(groups=2)
    one = found(frame, draws=20, reference="1 + adstock(x) + z", surrogates={"x": "1 + x"})
    words: dict[str, Any] = {"actions": ["x"], "formula": "1 + adstock(x) + z", "surrogates": {"x": "1 + x"}}
    estimator = CreditRegressor("w", "t", "g", draws=20, **words).fit(frame.drop(columns="y"), frame["y"])
    np.testing.assert_allclose(estimator.predict(frame.drop(columns="y")), one.steps["credit"], rtol=1e-12)
    assert {"credit_low", "weight_x"} <= {*estimator.model_.predict(frame)}


def test_columns_of_arrays_are_named_by_their_places() -> None:
    frame = table()[["w", "x", "z"]]
    y = table()["y"]
    one = CreditRegressor("w").fit(frame, y).predict(frame)
    other = CreditRegressor(0).fit(frame.to_numpy(), y.to_numpy()).predict(frame.to_numpy())
    np.testing.assert_allclose(one, other, rtol=1e-9)


def test_the_score_is_of_labels_of_windows_not_of_rows() -> None:
    frame = table(windows=60, noise=5)
    x, y = frame[["w", "x", "z"]], frame["y"]
    estimator = CreditRegressor("w").fit(x, y)
    sums = np.add.reduceat(estimator.predict(x), np.arange(0, 300, 5))
    labels = y.to_numpy()[::5]
    wanted = 1 - ((labels - sums) ** 2).sum() / ((labels - labels.mean()) ** 2).sum()
    assert estimator.score(x, y) == pytest.approx(wanted, rel=1e-9)
    some = y.where((frame.index % 5 == 2) & (frame["w"] != 3))  # on one row of a window; window 3 has none
    kept = np.arange(60) != 3
    wanted = 1 - ((labels - sums)[kept] ** 2).sum() / ((labels[kept] - labels[kept].mean()) ** 2).sum()
    assert estimator.score(x, some) == pytest.approx(wanted, rel=1e-9)
    again = CreditRegressor("w").fit(x, y.where(frame.index % 5 == 2))
    np.testing.assert_allclose(again.predict(x), estimator.predict(x), rtol=1e-9)


@pytest.mark.parametrize("label_is", ["mean", "last", "binary"])
def test_labels_may_be_means_or_of_the_last_row_or_bits(label_is: Any) -> None:
    frame = table(windows=100, noise=0.1)
    truth = 2 + 3 * frame["x"] - frame["z"]
    y = frame["y"] / 5 if label_is == "mean" else truth.groupby(frame["w"]).transform("last")
    y = (frame["y"] > frame["y"].median()).astype(int) if label_is == "binary" else y
    x = frame[["w", "x", "z"]]
    estimator = CreditRegressor("w", label_is=label_is).fit(x, y)
    assert np.corrcoef(estimator.predict(x), truth)[0, 1] > 0.98
    assert estimator.score(x, y) > 0.6


def test_validation_over_windows_chooses_the_formula_that_made_the_labels() -> None:
    frame = table(windows=60)
    x, y = frame[["w", "x", "z"]], frame["y"]
    grid = {"formula": ["1", "1 + x", "1 + x + z"], "regularization": [0.01, 30.0]}
    search = GridSearchCV(CreditRegressor("w"), grid, cv=GroupKFold(4)).fit(x, y, groups=frame["w"])
    assert search.best_params_ == {"formula": "1 + x + z", "regularization": 0.01}
    scores = cross_val_score(CreditRegressor("w", formula="1 + x + z"), x, y, groups=frame["w"], cv=GroupKFold(4))
    assert scores.min() > 0.9


def test_categories_of_frames_and_signs() -> None:
    frame = table(windows=60).assign(c=lambda own: np.where(own["z"] > 0, "warm", "cold"))
    x = frame[["w", "x", "c"]]
    estimator = CreditRegressor("w", sign={"x": "negative"}).fit(x, frame["y"])
    by = estimator.predict(x.assign(x=x["x"] + 1)) - estimator.predict(x)
    np.testing.assert_allclose(by, 0, atol=1e-12)  # where a sum of x cannot be worth less, it is worth nothing
    with pytest.raises(UserError, match="c of row 0 is 'hot', which the model has not seen"):
        estimator.predict(x.assign(c="hot"))


def test_it_stands_in_pipelines_and_is_pickled_and_cloned() -> None:
    frame = table()
    pipeline = make_pipeline(StandardScaler(), CreditRegressor()).fit(frame[["x", "z"]], frame["x"] * 2)
    np.testing.assert_allclose(pipeline.predict(frame[["x", "z"]]), frame["x"] * 2, atol=0.01)
    again = pickle.loads(pickle.dumps(pipeline))
    np.testing.assert_array_equal(again.predict(frame[["x", "z"]]), pipeline.predict(frame[["x", "z"]]))
    asked = CreditRegressor("w", surrogates={"x": "1 + x"}, seed=3)
    assert clone(asked).get_params() == asked.get_params()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"window": "wek"}, "data.window=wek: there is no such column"),
        ({"label_is": "total"}, "data.label_is=total"),
        ({"formula": "1 + q"}, "q"),
        ({"regularization": -1}, "0 or more"),
        ({"folds": 0}, "folds=0"),
        ({"draws": 0}, "draws=0"),
        ({"sign": {"x": "up"}}, "positive, negative"),
        ({"actions": ["q"]}, "'q'"),
        ({"surrogates": {"a/b": "1"}}, "no name"),
    ],
)
def test_wrong_parameters_are_refused_when_it_is_fitted(words: dict[str, Any], said: str) -> None:
    frame = table()
    with pytest.raises(UserError, match=said):
        CreditRegressor(**{"window": "w", **words}).fit(frame[["w", "x", "z"]], frame["y"])


def test_labels_that_differ_in_a_window_are_refused() -> None:
    frame = table()
    with pytest.raises(UserError, match="in rows of one window"):
        CreditRegressor("w").fit(frame[["w", "x"]], frame["x"])


def test_its_examples_run() -> None:
    done = doctest.testmod(module)
    assert done.failed == 0
    assert done.attempted > 5


def test_columns_of_any_name() -> None:
    frame = table()
    x = pd.DataFrame({"row": frame["x"], "y": frame["z"], "y_": 1.0})
    estimator = CreditRegressor().fit(x, 2 * frame["x"] - frame["z"])
    assert estimator.score(x, 2 * frame["x"] - frame["z"]) > 0.99

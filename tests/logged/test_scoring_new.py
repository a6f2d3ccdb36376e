"""Rows that were not fitted to: the fit's own table gives the fit's own steps, and what does not fit is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.result import LoggedCredit
from credit.logged.saving import SavedModel
from credit.logged.tables import sources
from credit.logged.tables.again import opened_again
from tests.logged.test_recovering import found, table

FORMULA = "1 + adstock(x) + lag(x, 1) + saturate(x) + bs(z, 4) + c + level"


def rows(groups: int = 2, windows: int = 40) -> pd.DataFrame:
    """The table with a category and a level, and one window without a label."""
    frame = table(windows=windows, groups=groups)
    random = np.random.default_rng(1)
    frame = frame.assign(c=random.choice(["hot", "cold"], len(frame)), level=random.normal(5, 1, len(frame)))
    frame.loc[frame["w"] == 7, "y"] = np.nan
    return frame


def fitted(frame: pd.DataFrame, **words: Any) -> LoggedCredit:
    plain = {"states": ["z", "c", "level"], "stock": ["level"], "reference": FORMULA, "surrogates": {"x": "1 + x"}}
    return found(frame, **{**plain, **words})


def again(one: LoggedCredit, folder: Path) -> SavedModel:
    one.model.write(folder / "model")
    return SavedModel.read(folder)


def bits(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(y=np.where(frame["y"].isna(), np.nan, frame["y"] > frame["y"].median()))


@pytest.mark.parametrize(
    ("label_is", "words"),
    [
        ("sum", {}),
        ("mean", {"nonnegative": True}),
        ("last", {"residual": "uniform"}),
        ("sum", {"reference": None, "surrogates": None, "calendar": []}),
        ("binary", {}),
    ],
)
def test_the_table_that_was_fitted_has_the_fits_own_steps(tmp_path: Path, label_is: str, words: dict[str, Any]) -> None:
    frame = rows()
    frame = bits(frame) if label_is == "binary" else frame.assign(y=frame["y"].abs())
    one = fitted(frame, label_is=label_is, **words)
    for model in (one.model, again(one, tmp_path)):
        new = model.scored(frame)
        pd.testing.assert_frame_equal(new.steps, one.steps, rtol=1e-12, atol=1e-12)
        pd.testing.assert_frame_equal(
            new.windows[["g", "w", "steps", "label", "predicted", "residual"]],
            one.windows[["g", "w", "steps", "label", "predicted", "residual"]],
        )
    assert one.steps["credit_low"].notna().all()
    assert one.steps["credit_balanced"].notna().all() == (label_is != "binary")


def test_dates_become_the_same_features(tmp_path: Path) -> None:
    frame = rows().assign(t=lambda own: pd.Timestamp("2024-01-01") + pd.to_timedelta(own["t"], unit="D"))
    words = {"calendar": ["weekday", "month"], "reference": None, "surrogates": {}}
    one = fitted(frame, **words)
    model = again(one, tmp_path)
    pd.testing.assert_frame_equal(model.predict(frame), one.steps, rtol=1e-12)
    text = frame.assign(t=frame["t"].dt.strftime("%Y-%m-%d"))
    np.testing.assert_allclose(model.predict(text)["credit"], one.steps["credit"], rtol=1e-12)


def test_rows_without_windows_and_labels_have_the_same_credit() -> None:
    frame = rows()
    one = fitted(frame, stock=[], residual="uniform")
    new = one.model.scored(frame.drop(columns=["w", "y"]))
    for name in ("credit", "credit_low", "credit_high", "disagreement", "weight_x", "credit_reference"):
        np.testing.assert_allclose(new.steps[name], one.steps[name], rtol=1e-12)
    assert new.windows is None
    assert "no column 'w'" in " ".join(new.said)
    unlabelled = one.model.scored(frame.drop(columns="y"))
    np.testing.assert_allclose(unlabelled.windows["predicted"], one.windows["predicted"], rtol=1e-12)
    assert unlabelled.windows["residual"].isna().all()
    assert np.isnan(unlabelled.r_squared)
    pd.testing.assert_frame_equal(one.predict(frame.drop(columns="y")), unlabelled.steps)


def test_rows_in_another_order_keep_their_credit() -> None:
    frame = rows()
    one = fitted(frame)
    mixed_up = frame.sample(frac=1, random_state=0)
    new = one.predict(mixed_up.reset_index(drop=True)).set_axis(mixed_up.index).sort_index()
    np.testing.assert_allclose(new["credit_balanced"], one.steps["credit_balanced"], rtol=1e-9)


def test_what_is_carried_begins_anew_with_each_group_of_the_new_table() -> None:
    frame = rows(groups=1)
    one = fitted(frame)
    late = frame[frame["w"] >= 20].reset_index(drop=True)
    new, old = one.model.scored(late), one.steps["credit"].to_numpy()[100:]
    assert not np.isclose(new.steps["credit"].iloc[0], old[0])
    np.testing.assert_allclose(new.steps["credit"].iloc[60:], old[60:], rtol=1e-3)
    assert "begin anew with the first row of each g" in " ".join(new.said)


def test_labels_that_were_never_seen_say_how_good_the_prediction_is() -> None:
    one = fitted(rows(), reference="1 + x + z", surrogates={})
    other = table(groups=1, seed=9).assign(c="hot", level=5.0)
    assert one.model.scored(other).r_squared > 0.9
    assert one.model.scored(other.assign(y=other["y"].to_numpy()[::-1])).r_squared < 0.2


def test_windows_that_the_labels_do_not_tell_get_no_prediction() -> None:
    frame = table(length=7)
    frame["day"] = pd.Categorical(np.tile([*"MTWRFSU"], 40), categories=[*"MTWRFSU"])
    one = found(frame, reference=None, surrogates={}, actions=["day", "x"], group=False)
    new = one.model.scored(frame.iloc[:-3])
    assert new.windows["told"].tolist() == [True] * 39 + [False]
    assert new.windows["predicted"].isna().tolist() == [False] * 39 + [True]
    assert "labels of 1 windows are not predicted" in " ".join(new.said)


def test_a_window_may_be_called_otherwise_and_labels_may_lie_in_a_second_table() -> None:
    frame = rows()
    one = fitted(frame)
    labels = frame.groupby(["g", "w"], as_index=False)["y"].first().rename(columns={"y": "sold", "w": "week"})
    other = frame.rename(columns={"w": "week", "t": "day"}).drop(columns="y")
    new = one.model.scored(other, window="week", label="sold", labels=labels, time="day")
    np.testing.assert_allclose(new.steps["credit_balanced"], one.steps["credit_balanced"], rtol=1e-9)


def test_a_table_in_parts_has_the_same_credit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = rows()
    one = fitted(frame)
    frame.to_parquet(tmp_path / "new.parquet", row_group_size=50)
    monkeypatch.setattr(sources, "CHUNK", 37)
    panel = opened_again(tmp_path / "new.parquet", {}, one.found.panel.known, memory=0)
    assert len(list(panel.parts())) > 3
    pd.testing.assert_frame_equal(one.model.score(panel).steps, one.steps, rtol=1e-12, atol=1e-12)


def test_missing_values_follow_the_words_of_the_fit_or_new_ones() -> None:
    frame = rows()
    one = fitted(frame)
    holes = frame.copy()
    holes.loc[3, "x"] = np.nan
    holes.loc[4, "c"] = None
    with pytest.raises(UserError, match=r"x 1, c 1.*data.missing=mean"):
        one.predict(holes)
    mean = one.predict(holes.drop(columns="y"), missing="mean")
    filled = holes.assign(x=holes["x"].fillna(frame["x"].mean()), c=holes["c"].fillna(frame["c"].mode()[0]))
    np.testing.assert_allclose(mean["credit"], one.predict(filled)["credit"], rtol=1e-9)
    assert len(one.predict(holes, missing="drop")) == len(frame) - 2
    with pytest.raises(UserError, match="none is left"):
        one.predict(holes.assign(x=np.nan), missing="drop")


def test_values_beyond_what_was_seen_are_said_and_levels_written_alike_are_the_same() -> None:
    frame = rows().assign(c=lambda own: np.where(own["c"] == "hot", "1", "2"))
    one = fitted(frame)
    new = one.model.scored(frame.assign(c=frame["c"].astype(float), z=frame["z"] + np.where(frame.index == 5, 50, 0)))
    assert any("z of 1 rows is outside" in sentence for sentence in new.said)
    np.testing.assert_allclose(np.delete(new.steps["credit"], [5]), np.delete(one.steps["credit"], [5]), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "words", "said"),
    [
        ({"x": None}, {}, "no column 'x', which the model needs; did you mean 'xx'"),
        ({"c": "warm"}, {}, "c of row 0 is 'warm', which the model has not seen, and 399 more rows"),
        ({"x": "much"}, {}, "x of row 0 is 'much'"),
        ({"x": pd.Timestamp("2024-01-01")}, {}, "x holds dates, and held numbers"),
        ({"t": None}, {}, "no column 't', which orders rows"),
        ({"g": None}, {}, "data.group=false none"),
        ({"w": None}, {}, "of a level \\(level\\) a window has the mean"),
        ({"w": None}, {"window": "week"}, "data.window=week"),
        ({}, {"label": "sold"}, "no column 'sold'"),
        ({}, {"labels": pd.DataFrame({"w": [1], "y": [1.0]}), "label": "sold"}, "data.labels: there is no column 'so"),
        ({}, {"actions": ["x"]}, "data.actions has no effect"),
        ({}, {"widow": "w"}, "did you mean 'window'"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(change: dict[str, Any], words: dict[str, Any], said: str) -> None:
    one = fitted(rows(windows=12), draws=2)
    frame = rows().assign(xx=0.0, **{name: value for name, value in change.items() if value is not None})
    frame = frame.drop(columns=[name for name, value in change.items() if value is None])
    with pytest.raises(UserError, match=said):
        one.predict(frame, **words)


def test_labels_have_no_rows_where_there_are_no_windows() -> None:
    one = fitted(rows(windows=12), draws=2, stock=[])
    for words in ({"label": "y"}, {"labels": pd.DataFrame({"w": [1], "y": [1.0]})}):
        with pytest.raises(UserError, match=r"data\.window"):
            one.predict(rows().drop(columns="w"), **words)


def test_bits_must_be_bits_in_the_new_table_too() -> None:
    one = fitted(bits(rows()), label_is="binary")
    with pytest.raises(UserError, match="binary allows 0 and 1"):
        one.predict(rows().assign(y=2.0))


def test_nothing_is_fitted_or_guessed_anew() -> None:
    frame = rows()
    one = fitted(frame)
    tiny = frame[(frame["w"] == 3) & (frame["g"] == "g0")].reset_index(drop=True)  # one window, one level of g
    assert len(one.predict(tiny)) == 5
    other = one.predict(tiny.assign(z=tiny["z"].mean()))
    assert other["credit"].notna().all()


@pytest.mark.parametrize("missing", ["mean", "drop"])
def test_gaps_of_the_fit_are_filled_as_they_were(missing: str) -> None:
    frame = rows()
    frame.loc[[3, 50, 51], "x"] = np.nan
    frame.loc[[7, 90], "c"] = None
    one = fitted(frame, missing=missing)
    pd.testing.assert_frame_equal(one.predict(frame), one.steps, rtol=1e-12, atol=1e-12)


def test_a_time_that_begins_anew_in_each_window_orders_new_rows_too(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    frame = pd.DataFrame({"window": np.repeat(np.arange(30), 3), "t": np.tile(np.arange(3), 30)})
    frame = frame.assign(x=random.normal(size=90), y=np.repeat(random.normal(size=30), 3))
    words: dict[str, Any] = {"reference": "1 + x", "surrogates": {}, "actions": ["x"], "states": []}
    one = found(frame, window="window", label="y", group=None, time=None, **words)
    order = random.permutation(90)
    model = again(one, tmp_path)
    for given in ({}, {"time": "t"}):
        new = model.score(opened_again(frame.iloc[order].reset_index(drop=True), given, model.known))
        pd.testing.assert_series_equal(
            new.steps["credit"], one.steps["credit"].iloc[order].reset_index(drop=True), check_exact=False
        )
    alone = model.score(opened_again(frame.drop(columns=["window", "y"]), {}, model.known))
    assert len(alone.steps) == 90

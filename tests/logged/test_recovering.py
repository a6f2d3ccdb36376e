"""A whole recovery from a table: against the truth, against Chow and Lin, and what must not depend on circumstances."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import credit
from credit.core.errors import UserError
from credit.logged.fits.mixture import mixed
from credit.logged.fits.ridge import solutions
from credit.logged.result import LoggedCredit
from credit.recovery.mixers import RelativeMSE
from tests.logged.fits.test_moments import plain
from tests.logged.residuals.peers import chow_lin

MARKETING = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "marketing.py"))


def table(windows: int = 40, length: int = 5, groups: int = 1, seed: int = 0, noise: float = 0.5) -> pd.DataFrame:
    """Rows with x (an action), z (a state) and a label y in the last row of a window: Σ 2 + 3x − z, and noise."""
    random = np.random.default_rng(seed)
    count = windows * length * groups
    frame = pd.DataFrame(
        {
            "g": np.repeat([f"g{i}" for i in range(groups)], windows * length),
            "w": np.tile(np.repeat(np.arange(windows), length), groups),
            "t": np.tile(np.arange(windows * length), groups),
            "x": random.gamma(2.0, size=count),
            "z": random.normal(size=count),
        }
    )
    credit_ = 2 + 3 * frame["x"] - frame["z"]
    sums = credit_.groupby([frame["g"], frame["w"]]).transform("sum") + noise * np.repeat(
        random.normal(size=windows * groups), length
    )
    return frame.assign(y=sums)


ROLES: dict[str, Any] = {
    "window": "w", "label": "y", "time": "t", "actions": ["x"], "states": ["z"], "group": "g"
}  # fmt: skip


def found(frame: pd.DataFrame, **words: Any) -> LoggedCredit:
    return credit.recover(frame, **{"draws": 20, "reference": "1 + x + z", **ROLES, **words})


def test_a_panel_whose_truth_is_known_is_recovered() -> None:
    rows, truth = MARKETING["panel"](1, regions=8, weeks=80)
    whole = credit.recover(rows, draws=60)
    assert whole.models == ("reference", "actions", "mixture")
    assert np.corrcoef(whole.steps["credit"], truth["credit"])[0, 1] > 0.97
    effects = whole.effects.set_index(["action", "model"])
    for channel in ("tv", "radio", "search", "social"):
        wanted = truth[channel].sum() / rows[channel].sum()
        for model in ("reference", "mixture"):
            line = effects.loc[(channel, model)]
            assert line["per_unit"] == pytest.approx(wanted, rel=0.15)
            assert line["per_unit_low"] < line["per_unit"] < line["per_unit_high"]
    assert whole.r_squared["mixture"][0] > 0.9


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_without_a_penalty_and_with_one_group_it_is_chow_and_lin(rho: float) -> None:
    frame = table(windows=30)
    one = found(frame, reference={"formula": "1 + x + z", "regularization": 0}, surrogates={}, rho=rho)
    design = np.column_stack([np.ones(len(frame)), frame["x"], frame["z"]])
    label = frame["y"].to_numpy()[::5]
    wanted = chow_lin(label, design, np.full(30, 5), rho)
    np.testing.assert_allclose(one.steps["credit_balanced"], wanted, rtol=1e-8, atol=1e-8)


def test_balanced_credit_adds_up_and_is_not_negative_where_that_is_asked() -> None:
    frame = table(groups=3)
    frame.loc[frame["w"] == 7, "y"] = np.nan
    for words in ({}, {"residual": "uniform"}, {"nonnegative": True}):
        one = found(frame, **words)
        sums = one.steps["credit_balanced"].groupby([frame["g"], frame["w"]]).sum()
        labels = frame.groupby(["g", "w"])["y"].first()
        known = labels.notna()
        np.testing.assert_allclose(sums[known], labels[known], rtol=1e-9)
        assert one.steps["credit_balanced"].notna().all()
        assert (one.steps["credit_balanced"] >= 0).all() or "nonnegative" not in words
        assert np.isfinite(one.windows["held_out"]).all()  # unlabelled windows get a prediction


def test_what_is_held_out_was_not_seen() -> None:
    frame = table(windows=60, groups=2)
    one = found(frame, surrogates={"x": "1 + x"}, rho=0.0, reference={"formula": "1 + x + z", "regularization": 2.0})
    r = one.found
    x, y = r.plain_design, r.panel.windows.label
    for number, (tested, fitted) in enumerate(r.folds.of):
        inside, outside = np.isin(r.folds.piece, fitted), np.isin(r.folds.piece, tested)
        theta = solutions(plain(x[inside], y[inside]), np.array([2.0]), 0, plain(x, y))[0]
        np.testing.assert_allclose(one.judged.held_out[0][outside], x[outside] @ theta, rtol=1e-6)
        phi = [np.column_stack([np.ones(len(frame)), frame["x"], frame["z"]]), np.ones((len(frame), 2))]
        phi[1][:, 1] = frame["x"]
        whole = mixed(phi, list(r.held[number]), RelativeMSE()).credit
        sums = np.add.reduceat(whole, np.arange(0, len(frame), 5))
        np.testing.assert_allclose(one.judged.held_out[-1][outside], sums[outside], rtol=1e-9)


def test_rows_in_another_order_have_the_same_credit() -> None:
    frame = table(groups=3)
    mixed_up = frame.sample(frac=1, random_state=0)
    one, other = found(frame), found(mixed_up.reset_index(drop=True))
    other_steps = other.steps.set_axis(mixed_up.index).sort_index()
    for name in ("credit", "credit_low", "credit_balanced", "disagreement"):
        np.testing.assert_allclose(one.steps[name], other_steps[name], rtol=1e-9)


def test_below_ten_units_there_is_no_interval_and_it_is_said() -> None:
    one = found(table(windows=8))
    assert one.steps["credit_low"].isna().all()
    assert one.effects["effect_low"].isna().all()
    assert one.effects["effect"].notna().all()
    assert any("no intervals" in sentence for sentence in one.said)


def test_what_windows_do_not_tell_gets_no_number() -> None:
    frame = table(length=7)
    frame["day"] = pd.Categorical(np.tile([*"MTWRFSU"], 40), categories=[*"MTWRFSU"])
    one = found(frame, reference=None, surrogates=None, actions=["day", "x"], group=False)
    effects = one.effects[one.effects["model"] == "mixture"].set_index("action")
    assert effects.loc["day", "effect"].isna().all()
    assert not effects.loc["day", "told"].any()
    assert np.isfinite(effects.loc["x", "effect"])
    assert one.found.telling.relations
    assert "first 6 of its 7 rows" in " ".join(relation.remedy for relation in one.found.telling.relations)


def test_labels_that_are_means_or_of_the_last_row() -> None:
    frame = table(groups=2, noise=0.01)
    mean = found(frame.assign(y=frame["y"] / 5), label_is="mean", surrogates={})
    assert np.corrcoef(mean.steps["credit"], 2 + 3 * frame["x"] - frame["z"])[0, 1] > 0.999
    np.testing.assert_allclose(
        mean.steps["credit_balanced"].groupby([frame["g"], frame["w"]]).mean(),
        frame.groupby(["g", "w"])["y"].first() / 5,
        rtol=1e-9,
    )
    truth = 2 + 3 * frame["x"] - frame["z"]
    last = found(frame.assign(y=truth.groupby([frame["g"], frame["w"]]).transform("last")), label_is="last")
    np.testing.assert_allclose(last.steps["credit"], truth, atol=0.1)


def test_bits_are_log_odds() -> None:
    frame = table(windows=150, groups=2)
    sums = frame.groupby(["g", "w"])["y"].transform("first")
    one = found(frame.assign(y=(sums > sums.median()).astype(int)), surrogates={"x": "1 + x"})
    truth = 3 * frame["x"] - frame["z"]
    assert np.corrcoef(one.steps["credit"], truth)[0, 1] > 0.98
    assert one.steps["credit_balanced"].isna().all()
    assert one.windows["predicted"].between(0, 1).all()
    assert one.windows["held_out"].between(0, 1).all()
    assert one.r_squared["reference"][0] > 0.5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"drows": 3}, "did you mean 'draws'"),
        ({"draws": 0}, "draws=0"),
        ({"level": 1.5}, "level=1.5"),
        ({"residual": "ar2"}, "residual='ar2'"),
        ({"reference": "1 + q"}, "q"),
        ({"reference": {"formla": "1"}}, "did you mean 'formula'"),
        ({"reference": {"regularization": -1}}, "0 or more"),
        ({"reference": {"sign": {"q": "positive"}}}, "sign of 'q'"),
        ({"reference": {"sign": {"x": "up"}}}, "positive, negative"),
        ({"surrogates": {"a/b": "1"}}, "no name"),
        ({"surrogates": {"mixture": "1"}}, "no name"),
        ({"residual": "uniform", "rho": 0.5}, "rho has no effect"),
        ({"surrogates": {"a": "1 + __import__('os')"}}, "surrogates.a"),
        ({"nonnegative": True, "label_is": "sum", "negative": True}, "no word 'negative'"),
    ],
)
def test_wrong_words_are_refused(words: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said.replace("(", r"\(")):
        found(table(), **words)


def test_it_says_what_it_is_in_a_line() -> None:
    assert repr(found(table())).startswith("LoggedCredit(200 rows, 40 windows, reference+actions, held-out R²")


def test_without_actions_there_are_no_effects() -> None:
    one = found(table(), actions=[], states=["x", "z"])
    for frame in (one.effects, one.placebo, one.robustness):
        assert len(frame) == 0
    assert one.steps["credit"].notna().all()
    assert one.models == ("reference",)


def test_without_the_package_of_formulas_all_columns_are_a_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("credit.logged.asking.importlib.util.find_spec", lambda name: None)
    one = found(table(), reference=None)
    assert one.models == ("reference",)
    assert one.r_squared["reference"][0] > 0.9


def test_an_effect_is_called_an_association_unless_the_action_was_drawn() -> None:
    assert any("effects of x are associations" in sentence for sentence in found(table()).said)
    assert not any("associations" in sentence for sentence in found(table(), randomised=["x"]).said)


def test_options_that_bits_make_useless_are_refused() -> None:
    frame = table()
    bits = frame.assign(y=(frame["y"] > frame["y"].median()).astype(int))
    for words in ({"nonnegative": True}, {"rho": 0.5}):
        with pytest.raises(UserError, match="no effect: labels are bits"):
            found(bits, **words)


def test_steps_have_the_index_of_the_frame() -> None:
    frame = table(windows=30, groups=2)
    whole = found(frame, surrogates={}).steps
    mixed_up = frame.sample(frac=1, random_state=0)
    again = found(mixed_up, surrogates={}).steps
    assert list(again.index) == list(mixed_up.index)
    np.testing.assert_allclose(again["credit"].sort_index(), whole["credit"], rtol=1e-9)


def test_a_label_of_words_is_refused() -> None:
    with pytest.raises(UserError, match="y of row 0 is 'a lot', and it is"):
        credit.recover(table().assign(y="a lot"), window="w", label="y")


def test_the_interval_of_a_coefficient_is_of_its_term_in_every_draw_whatever_decay_it_chose() -> None:
    one = found(table(noise=3.0), reference="1 + adstock(x) + z", surrogates={}, draws=30)
    fit, terms = one.found.plain_fit, one.found.plain.terms
    assert len(np.unique(fit.chosen[:, 0])) > 1
    line = one.told[one.told["column"].str.startswith("adstock")].iloc[0]
    own = fit.theta[:, terms.choices[0].columns].sum((1, 2))  # 0 for all but the candidate that was chosen
    assert line["high"] - line["coefficient"] == pytest.approx(one.found.factor * own[1:].std())
    assert line["low"] > 0


def test_labels_that_are_proportional_to_the_lengths_of_windows_leave_nothing_to_explain() -> None:
    random = np.random.default_rng(3)
    lengths = random.integers(3, 8, 40)
    frame = pd.DataFrame({"w": np.repeat(np.arange(40), lengths), "x": random.choice(["a", "b"], lengths.sum())})
    frame["z"] = random.normal(size=len(frame))
    frame["y"] = 0.1 * lengths.repeat(lengths)
    one = found(frame, time=None, group=None, surrogates=None, reference=None)
    assert one.rate == pytest.approx(0.1)
    assert "labels are proportional to windows' lengths (0.1 a row): nothing is left for columns to explain" in one.said
    assert np.isnan(one.r_squared["mixture"][0])
    assert (one.effects[["effect", "total_low", "total_high"]] == 0).all(axis=None)
    assert one.found.units.in_time == 0  # rounding is not taken for what lasts
    assert np.isnan(one.durbin_watson)
    np.testing.assert_allclose(one.steps["credit"], 0.1)
    words = one.report()
    assert "too few windows" not in words
    assert "nothing is left for actions to explain" in words
    assert "largest number" not in words
    assert "Here they say the same of every row." in words
    assert "e−1" not in words


def test_labels_of_windows_of_other_lengths_are_not_proportional() -> None:
    assert found(table()).rate is None


@pytest.mark.parametrize(("draws", "over"), [(1, "one draw has no deviation"), (9, "a deviation over 9 draws")])
def test_below_ten_draws_there_is_no_interval_and_that_is_said(draws: int, over: str) -> None:
    one = found(table(), draws=draws)
    (said,) = [sentence for sentence in one.said if "intervals" in sentence]
    assert said.startswith(f"there are no intervals: {over}")
    assert one.steps[["credit_low", "credit_high"]].isna().all(axis=None)
    assert one.effects[["total_low", "per_unit_high"]].isna().all(axis=None)
    assert one.told["low"].isna().all()
    assert one.placebo["low"].isna().all()
    assert not one.placebo["explains"].any()
    words = one.report()
    assert "90% intervals" not in words
    assert f"{draws} draws are too few" in words


def test_ten_draws_are_enough_for_an_interval() -> None:
    assert (found(table(), draws=10).effects["total_high"] > 0).all()


@pytest.mark.parametrize(("rho", "whitened"), [(0.9, True), (0.0, False)])
def test_correlations_of_what_is_left_say_whether_what_lasts_was_taken_out(rho: float, whitened: bool) -> None:
    one = found(table(), rho=rho)
    taken = "once what lasts from row to row is taken out, correlation of windows that follow each other"
    assert (taken in one.found.units.said) == whitened
    words = one.report()
    assert ("what lasts from row to row is still in it" in words) == whitened
    assert "40 parts of the table weighed anew, which are independent of each other as far as can be seen" in words

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.panel import Roles
from credit.logged.tables.guesses import Sample, named
from credit.logged.tables.roles import settled
from credit.logged.tables.words import Words

from .tables import decisions, marketing


def guessed(frame: pd.DataFrame, **given: Any) -> tuple[Roles, str]:
    found = settled(Words.of(given), Sample(frame, "table"), None)
    return found.roles, "\n".join(found.said)


@pytest.mark.parametrize("shuffled", [False, True])
def test_a_panel_of_regions(shuffled: bool) -> None:
    frame = marketing(days=140)
    frame["id"] = np.arange(len(frame))
    roles, said = guessed(frame.sample(frac=1, random_state=0).reset_index(drop=True) if shuffled else frame)
    assert (roles.window, roles.label, roles.time, roles.group) == ("week", "sales", "day", "region")
    assert (roles.actions, roles.states) == (("tv", "radio"), ("temperature", "sky", "region"))
    assert "data.window=week" in said
    assert "id is left out: by its name it only numbers rows" in said


def test_dates_as_text_and_labels_on_the_last_row_only() -> None:
    frame = marketing(1, 60).drop(columns="region")
    frame["date"] = frame.pop("day").dt.strftime("%Y-%m-%d")
    frame["sales"] = frame.sales.where(frame.week != frame.week.shift(-1))
    roles, said = guessed(frame)
    assert (roles.window, roles.label, roles.time, roles.group) == ("week", "sales", "date", None)
    assert "all rows are one series" in said


def test_episodes_of_an_agent() -> None:
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"episode": np.repeat(np.arange(30), 5), "step": np.tile(np.arange(5), 30)})
    frame["s"], frame["a"], frame["reward"] = rng.integers(0, 4, 150), rng.integers(0, 2, 150), rng.normal(size=150)
    frame["success"] = np.repeat(rng.integers(0, 2, 30), 5)
    roles, said = guessed(frame)
    assert (roles.window, roles.label, roles.time, roles.group) == ("episode", "success", None, None)
    assert (roles.actions, roles.states) == (("a",), ("s",))
    assert "data.time=step: it begins anew in each episode" in said
    assert roles.label_is == "binary"
    assert "reward is left out" in said
    assert "data.label_is=binary" in said


def test_patients_are_windows_and_series_in_one() -> None:
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"patient": np.repeat([f"p{i}" for i in range(20)], 6), "hour": np.tile(np.arange(6), 20)})
    frame["dose"], frame["outcome"] = rng.exponential(size=120), np.repeat(rng.normal(size=20), 6)
    roles, _ = guessed(frame)
    assert (roles.window, roles.label, roles.time, roles.group) == ("patient", "outcome", None, None)
    assert roles.actions == ("dose",)


def test_what_is_said_is_not_guessed() -> None:
    frame = marketing(days=140)
    roles, _ = guessed(frame, states=["tv"], group=False, time="day")
    assert (roles.states, roles.actions) == (("tv",), ("region", "radio", "temperature", "sky"))
    assert roles.group is None
    roles, _ = guessed(frame, actions=["radio"], states=[])
    assert (roles.states, roles.actions) == ((), ("radio",))


def test_levels_are_pointed_at_but_never_guessed() -> None:
    frame = marketing(days=140)
    frame["inventory"] = np.random.default_rng(1).normal(size=len(frame))
    roles, said = guessed(frame)
    assert roles.stock == ()
    assert "say data.stock=[inventory]" in said


def test_copies_of_the_label_are_left_out() -> None:
    frame = marketing(days=140)
    frame["units"] = frame.sales
    roles, said = guessed(frame)
    assert "units" not in roles.features
    assert "units is left out: it equals sales, the label" in said


def test_questions_that_nothing_answers_are_asked() -> None:
    frame = marketing(days=140).rename(columns={"sales": "north"})
    frame["south"] = frame.north**2
    with pytest.raises(UserError, match=r"north, south each have one value in a week; say data\.label"):
        guessed(frame)
    with pytest.raises(UserError, match=r"which rows share a label cannot be told; say data\.window"):
        guessed(marketing().drop(columns=["week", "sky", "day"]).assign(sales=np.arange(84) ** 2.0), label="sales")


def test_words_are_found_in_names() -> None:
    assert named("tv_spend", ("tv",)) == 0
    assert named("spendTv", ("tv",)) == 0
    assert named("latvia", ("tv",)) is None


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"window": "window"},
        {"window": "window", "states": ["state"], "actions": ["action"]},
        {"window": "window", "states": ["state"], "actions": ["action"], "time": "t"},
        {"states": ["action"], "actions": ["state"]},
    ],
)
@pytest.mark.parametrize("labels", ["last", "all"])
def test_a_column_that_cuts_windows_apart_tells_no_series_apart(given: dict[str, Any], labels: str) -> None:
    frame = decisions()
    if labels == "all":
        frame["label"] = frame.groupby("window").label.transform("max")
    roles, said = guessed(frame, **given)
    assert (roles.window, roles.label, roles.time, roles.group) == ("window", "label", None, None)
    assert {*roles.states, *roles.actions} == {"state", "action"}
    assert "t: it begins anew in each window" in said


def test_what_is_said_to_be_something_else_tells_no_series_apart() -> None:
    frame = decisions().assign(label=lambda f: f.groupby("window").label.transform("max"))
    frame = frame.rename(columns={"window": "week", "state": "region", "action": "store"})
    for given in ({"states": ["region"], "actions": ["store"]}, {"actions": ["region"]}, {"states": ["region"]}):
        assert guessed(frame, window="week", **given)[0].group is None
    assert guessed(frame.assign(region=np.arange(len(frame)) // 180), window="week", cost={"store": "region"},
                   actions=["store"])[0].group is None  # fmt: skip


def test_what_was_printed_can_be_said() -> None:
    frame = marketing(days=140)
    free, _ = guessed(frame)
    again, _ = guessed(frame, actions=[*free.actions], states=[*free.states])  # region among them
    assert again == free


def test_words_for_windows_come_first() -> None:
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"day": np.repeat(np.arange(20), 6), "window": np.repeat(np.arange(40), 3)})
    frame["a"], frame["label"] = rng.normal(size=120), np.repeat(rng.normal(size=20), 6)
    assert guessed(frame)[0].window == "window"
    assert guessed(frame.rename(columns={"window": "n"}))[0].window == "day"


def test_a_label_of_all_series_is_that_of_windows_across_them() -> None:
    frame = marketing(days=140)
    frame["sales"] = frame.groupby("week").sales.transform("sum")
    roles, _ = guessed(frame)
    assert (roles.window, roles.group, roles.time) == ("week", None, "day")


def test_seeds_are_series_and_marks_of_ends_are_no_features() -> None:
    frame = pd.concat([decisions(seed=seed).assign(seed=seed) for seed in (3, 4)])
    frame["episode"], frame["step"] = frame.pop("window") // 2, frame.pop("t")
    frame["window"] = np.tile(np.repeat(np.arange(120), 3), 2)
    frame["terminated"] = frame["truncated"] = frame["done"] = (frame.step == 2) & (frame.window % 5 == 0)
    roles, said = guessed(frame)
    assert (roles.window, roles.group, roles.time) == ("window", "seed", None)
    assert (roles.states, roles.actions) == (("state",), ("action",))
    assert "terminated is left out: by its name it says where an episode ended" in said


def test_columns_in_another_unit_are_left_out_or_named() -> None:
    frame = marketing(days=140)
    frame["tv_cost"], frame["kelvin"], frame["calm"] = 1.7 * frame.tv, frame.temperature + 273.15, 1 - frame.radio
    roles, said = guessed(frame)
    assert (roles.actions, roles.states) == (("tv", "radio"), ("temperature", "sky", "region"))
    assert "tv_cost is left out: tv_cost = 1.7·tv in every row, and no window tells them apart" in said
    assert "kelvin = 273.15 + temperature" in said
    assert "calm = 1 − radio" in said
    roles, said = guessed(frame, actions=["tv_cost", "radio"])
    assert "tv" not in roles.states
    roles, said = guessed(frame, actions=["tv", "tv_cost"], states=["kelvin"])
    assert roles.actions == ("tv", "tv_cost")
    assert "WARNING: tv_cost = 1.7·tv in every row" in said
    assert "data.cost={tv: tv_cost}" in said
    near = frame.assign(tv_cost=1.7 * frame.tv + 1e-4 * np.arange(len(frame)), calm=frame.temperature**2)
    assert {"tv_cost", "calm"} <= {*guessed(near)[0].features}
    near.loc[3, "kelvin"] = np.nan  # a row in which it is not known
    assert "kelvin" in guessed(near)[0].features

"""The page of a recovery: its numbers are those of the frames, and whatever the table, it is a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import credit
from credit.core.errors import UserError
from credit.logged.report.numbers import interval, number, percent
from credit.logged.result import LoggedCredit
from tests.logged.report.pages import Page, asked_for
from tests.logged.tables.tables import marketing
from tests.logged.test_recovering import found, table

NASTY = "<script>alert(1)</script>"


def page(result: LoggedCredit) -> Page:
    """The report, which is whole, and asks for nothing."""
    html = result.report()
    read = Page(html)
    assert read.open == []
    assert asked_for(read) == []
    assert "://" not in html
    assert not {"script", "link", "iframe", "img"} & {tag for tag, _ in read.tags}
    assert len(html) < 1_000_000
    for words in ("nan", "None", "(empty)"):
        assert f" {words} " not in read.text.replace("\n", " ")
    return read


@pytest.fixture(scope="module")
def panel() -> LoggedCredit:
    return credit.recover(marketing(regions=4, days=140).drop(columns="sky"), draws=20)


@pytest.fixture(scope="module")
def read(panel: LoggedCredit) -> Page:
    return page(panel)


def test_effects_are_those_of_the_frame(panel: LoggedCredit, read: Page) -> None:
    lines = {line["action"]: line for line in read.table("action")}
    frame = panel.effects[panel.effects["model"] == "mixture"]
    assert [*lines] == [*frame.sort_values("total", key=abs, ascending=False)["action"]]
    for line in frame.to_dict("records"):
        shown = lines[line["action"]]
        for title, key in (("in total", "total"), ("per unit", "per_unit")):
            wanted = interval(*(line[f"{key}{end}"] for end in ("", "_low", "_high")))
            assert shown[title] == " ".join(wanted)
    by_reference = panel.effects.query("model == 'reference'").set_index("action")["total"]
    assert {name: line["in total by model “reference”"] for name, line in lines.items()} == {
        name: number(by_reference[name], 4) for name in lines
    }


def test_what_is_held_out_is_said_against_both_yardsticks(panel: LoggedCredit, read: Page) -> None:
    lines = {line["model"]: line for line in read.table("model")}
    assert [*lines] == [*panel.models]
    for name, (alike, last) in panel.r_squared.items():
        assert lines[name]["R² against all rows alike"] == number(alike)
        assert lines[name]["R² against the last window"] == number(last)
    alike, last = panel.r_squared["mixture"]
    assert f"rows are alike, squared errors are {percent(alike)} smaller (R² {number(alike)})" in read.text
    assert f"in the last window, squared errors are {percent(last)} smaller (R² {number(last)})" in read.text
    assert lines["reference"]["weight"] == percent(float(panel.rows.weights[0].mean()))


def test_it_says_what_it_is_and_what_it_is_not(panel: LoggedCredit, read: Page) -> None:
    for words in (
        "560 rows of 4 series (region) in 80 windows (week), beginning with day 2024‑01‑01",
        "Numbers of tv and radio are associations",
        "one for its expected credit",
        "weighed anew",
        "“explain",
        f"Durbin–Watson of what is left of labels: {number(panel.durbin_watson)}",
        *panel.said,
    ):
        assert words in read.text


def test_pictures_have_words_and_stay_words(read: Page) -> None:
    assert len(read.pictures) == 5
    assert all(len(says) > 20 for says in read.pictures)
    assert "tv" in read.pictures[0]
    texts = [attributes for tag, attributes in read.tags if tag == "text"]
    assert len(texts) > 50
    colours = " ".join(str(attributes.get("style", "")) for _, attributes in read.tags)
    assert "#" not in colours.replace("url(#", "")  # so that the dark has its own
    names = [str(attributes["id"]) for _, attributes in read.tags if "id" in attributes]
    assert len(names) == len(set(names))


def test_the_rows_where_models_lie_farthest_apart_are_those_of_the_frame(panel: LoggedCredit, read: Page) -> None:
    apart = (panel.steps["credit_reference"] - panel.steps["credit_actions"]).abs()
    steps = panel.steps.assign(apart=apart).sort_values("apart", ascending=False).head(10)
    lines = read.table("region")
    assert [int(line["row"]) for line in lines] == [*steps.index]
    assert [line["disagreement"] for line in lines] == [number(one, 4) for one in steps["disagreement"]]
    assert [line["apart"] for line in lines] == [number(one, 4) for one in steps["apart"]]
    assert [line["day"] for line in lines] == [str(day).removesuffix(" 00:00:00") for day in steps["day"]]
    assert [line["by model “actions”"] for line in lines] == [number(one, 4) for one in steps["credit_actions"]]


def test_the_same_recovery_gives_the_same_bytes() -> None:
    one, other = (found(table(windows=12), draws=5).report() for _ in range(2))
    assert one == other


def test_names_of_columns_are_words() -> None:
    names = {"x": NASTY, "z": '$a_b$ & "q" \'p\' id="z"', "g": "<b>", "y": "läbel\n日本 #1d2430 font: 12px a;"}
    frame = table(groups=3).rename(columns=names)
    frame["<b>"] = "<i>" + frame["<b>"]
    read = page(
        credit.recover(
            frame, window="w", label=names["y"], time="t", group="<b>", actions=[NASTY], states=[names["z"]], draws=15
        )
    )
    assert all("style" in attributes for tag, attributes in read.tags if tag == "i")  # dots of a key, no <i>g0
    assert [line["action"] for line in read.table("action")] == [NASTY]
    assert "läbel 日本 #1d2430 font: 12px a;" in read.text
    assert names["z"] in read.text
    assert "<i>g0" in read.text
    drawn = "".join(str(attributes.get("aria-label")) for _, attributes in read.tags)
    assert NASTY in drawn


def no_actions() -> LoggedCredit:
    return found(table(groups=2), actions=[], states=["x", "z"], surrogates={})


def few_windows() -> LoggedCredit:
    return found(table(windows=8), surrogates={})


def bits() -> LoggedCredit:
    frame = table(groups=2)
    return found(frame.assign(y=(frame["y"] > frame["y"].median()).astype(float)), label_is="binary", draws=10)


def means() -> LoggedCredit:
    return found(table(groups=2), label_is="mean")


def no_time() -> LoggedCredit:
    frame = table().drop(columns=["t", "g"])
    return credit.recover(frame, window="w", label="y", actions=["x"], states=["z"], draws=15)


def missing_labels() -> LoggedCredit:
    frame = table(groups=2)
    return found(frame.assign(y=frame["y"].where((frame["w"] < 30) & ((frame["g"] == "g0") | (frame["x"] > 0)))))


def missing_under_an_action() -> LoggedCredit:
    frame = table(groups=4)
    frame["x"] = np.where(frame["g"] == "g0", 5.0, frame["x"].clip(upper=1))
    return found(frame.assign(y=frame["y"].where((frame["g"] != "g0") | (frame["w"] > 35))))


def categories() -> LoggedCredit:
    frame = table(groups=3)
    kinds = np.random.default_rng(1).choice(["none", "a", "b <i>"], p=[0.6, 0.2, 0.2], size=len(frame))
    worth = pd.Series(kinds).map({"none": 0.0, "a": 2.0, "b <i>": -1.0})
    frame["y"] += worth.groupby([frame["g"], frame["w"]]).transform("sum")
    frame["spent"] = 2 * frame["x"]
    formula = "1 + x + z + kind"
    return found(frame.assign(kind=kinds), actions=["x", "kind"], cost={"x": "spent"}, reference=formula)


def untold() -> LoggedCredit:
    frame = table(groups=2)
    frame = frame.assign(mirror=2 * frame["x"], never=0.0)
    return found(frame, actions=["x", "mirror", "never"], reference="1 + x + mirror + never + z", surrogates={})


def nothing() -> LoggedCredit:
    frame = table(groups=2)
    random = np.random.default_rng(1).normal(size=80)
    return found(frame.assign(y=np.repeat(random, 5)), surrogates={})


def policy() -> LoggedCredit:
    random = np.random.default_rng(0)
    frame = table(groups=6, length=2).drop(columns=["x", "z"])
    frame["x"], frame["z"] = random.choice(["a", "b"], len(frame)), random.choice(["hot", "cold"], len(frame))
    worth = (frame["x"] == "a") + 2.0 * (frame["z"] == "hot") * (frame["x"] == "b") + random.normal(0, 0.2, len(frame))
    frame["y"] = worth.groupby([frame["g"], frame["w"]]).transform("sum")
    return found(frame, reference="1 + x * z", surrogates={"x": "1 + x"}, randomised=["x"])


def _more(recovered: Callable[[], LoggedCredit], said: list[str]) -> Any:
    """One more of a kind."""
    return pytest.param(recovered, said, marks=pytest.mark.thorough)


@pytest.mark.parametrize(
    ("recovered", "said"),
    [
        (no_actions, ["No column was named as an action"]),
        (few_windows, ["There is one model, reference", "There are no intervals: with fewer than ten"]),
        (bits, ["yes or no", "log-odds a unit", "Numbers are log-odds"]),
        (nothing, ["Of x it cannot be said whether it brought anything", "no better than by a guess"]),
        (categories, ["kind = b <i>", "per cost"]),
        (
            untold,
            ["Of x and mirror these windows tell nothing", "mirror = 2·x", "only rows in which one", "never moved"],
        ),
        _more(means, ["in an average row"]),
        _more(no_time, ["in 40 windows (w). Of each window"]),
        _more(missing_labels, ["Of 60 of these windows"]),
        _more(missing_under_an_action, ["Labels are no fair sample of all windows", "x 5 ("]),
        _more(policy, ["A policy from this log", "doubly robust", "It was said that x was drawn at random"]),
    ],
)
def test_every_kind_of_table_has_a_page(recovered: Callable[[], LoggedCredit], said: list[str]) -> None:
    text = page(recovered()).text
    for words in said:
        assert words in text


@pytest.mark.thorough
def test_what_is_not_told_gets_no_number() -> None:
    lines = {line["action"]: line for line in page(untold()).table("action")}
    for name in ("x", "mirror"):
        assert (lines[name]["in total"], lines[name]["per unit"]) == ("—", "—")
        assert "do not tell it" in lines[name]["note"]


@pytest.mark.thorough
def test_many_actions_are_all_in_tables_and_some_in_pictures() -> None:
    random = np.random.default_rng(0)
    names = [f"a{number:02d}" for number in range(30)]
    frame = pd.DataFrame(random.random((600, 30)), columns=names).assign(w=np.arange(600) // 3)
    frame["y"] = (frame[names] @ random.normal(size=30)).groupby(frame["w"]).transform("sum")
    read = page(credit.recover(frame, window="w", label="y", actions=names, states=[], draws=10))
    shown = [line[0] for one in read.tables if one[0][:3] == ["action", "baseline", "in total"] for line in one[1:]]
    assert sorted(shown) == names
    assert "The 20 largest are shown." in read.text
    assert "10 more actions" in read.text


def test_it_is_written_where_it_is_told(tmp_path: Path) -> None:
    one = few_windows()
    assert one.to_html(tmp_path / "page.html").read_text(encoding="utf-8") == one.report()
    with pytest.raises(UserError, match=r"there is no folder .*none; make it"):
        one.to_html(tmp_path / "none" / "page.html")

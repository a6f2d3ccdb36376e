"""Words with intervals and several values, as Optuna's distributions."""

from __future__ import annotations

from typing import Any

import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from credit.core.errors import UserError
from credit.tuning.space import Space, read, rounded

CONFIG = {
    "mixer": {"_target_": "credit.recovery.mixers.RelativeMSE", "alpha": 0.5},
    "uncertainty": {"_target_": "credit.recovery.uncertainty.bootstrap.Bootstrap", "draws": 20},
}


def space(*words: str) -> Space:
    return read(words, CONFIG)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("interval(.1,1)", FloatDistribution(0.1, 1.0)),
        ("tag(log,interval(1e-4,1))", FloatDistribution(1e-4, 1.0, log=True)),
        ("int(interval(1,8))", IntDistribution(1, 8)),
        ("tag(log,int(interval(1,8)))", IntDistribution(1, 8, log=True)),
        ("interval(1,8)", FloatDistribution(1.0, 8.0)),
        ("range(1,10,2)", IntDistribution(1, 9, step=2)),
        ("range(0,1,.25)", FloatDistribution(0.0, 0.75, step=0.25)),
        ("range(9,3,-3)", IntDistribution(6, 9, step=3)),
        (".1,2,x,true", CategoricalDistribution([0.1, 2, "x", True])),
        ("choice([count],[count,disagreement])", CategoricalDistribution(["[count]", "[count,disagreement]"])),
    ],
)
def test_what_is_searched(text: str, found: Any) -> None:
    assert space(f"some.key={text}").ranges == {"some.key": found}


def test_a_key_of_whole_numbers_is_searched_among_them() -> None:
    found = space("uncertainty.draws=interval(2,30)", "mixer.alpha=interval(1,2)", "seed=3")
    assert found.ranges["uncertainty.draws"] == IntDistribution(2, 30)
    assert found.ranges["mixer.alpha"] == FloatDistribution(1.0, 2.0)
    assert found.fixed == ("seed=3",)


def test_a_pattern_stands_for_options() -> None:
    assert space("mixer=glob(re*)").ranges["mixer"].choices == ("reference_only", "relative_mse")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["seed=1"], "nothing is searched; give a key an interval"),
        (["x=interval(1,0)"], r"'x=interval\(1,0\)' has no values: it goes from 1.0 to 0.0"),
        (["x=tag(log,interval(0,1))"], "a logarithm is of numbers above 0, and 0.0 is none"),
        (["x=tag(square,interval(0,1))"], "a tag is log, and of an interval"),
        (["x=tag(log,range(1,9))"], "a tag is log, and of an interval"),
        (["x=range(5,3)"], "has no values: it goes from 5 to 3"),
        (["mixer={a:1},{b:2}"], "{a:1} is a mapping, and no value; choose among the options of a group"),
        (["x=interval(1,0)", "mixer=glob(zz*)"], r"(?s)it goes from 1.0.*fits no option"),
    ],
)
def test_what_cannot_be_searched(words: list[str], said: str) -> None:
    with pytest.raises(UserError, match=said):
        space(*words)


def test_words_of_a_trial_and_of_the_corners() -> None:
    found = space("mixer.alpha=interval(.1,1)", "mixer=best,stacking", "+a@b.c=x,y")
    assert found.words({"mixer.alpha": 0.3, "mixer": "best", "+a@b.c": "y"}) == [
        "mixer.alpha=0.3",
        "mixer=best",
        "+a@b.c=y",
    ]
    corners = [" ".join(found.words(values)) for values in found.corners()]
    assert corners == [
        "mixer.alpha=0.1 mixer=best +a@b.c=x",
        "mixer.alpha=1.0 mixer=best +a@b.c=x",
        "mixer.alpha=0.1 mixer=stacking +a@b.c=x",
        "mixer.alpha=0.1 mixer=best +a@b.c=y",
    ]
    assert space("k=true,false").words({"k": True}) == ["k=true"]


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (["mixer.alpha=interval(.1,1)"], {"mixer.alpha": 0.5}),
        (["mixer.alpha=interval(.6,1)"], None),
        (["mixer.alpha=.1,.5"], {"mixer.alpha": 0.5}),
        (["mixer.alpha=.1,.4"], None),
        (["mixer.alpha=range(.1,1,.3)"], None),  # .1, .4, .7
        (["uncertainty.draws=interval(2,30)"], {"uncertainty.draws": 20}),
        (["mixer=best,stacking"], None),
        (["mixer.beta=1,2"], None),
    ],
)
def test_whether_the_default_is_searched(words: list[str], values: Any) -> None:
    assert space(*words).values_in(CONFIG) == values


@pytest.mark.parametrize(
    ("words", "count"),
    [
        (["a=1,2,3", "b=range(0,1,.25)", "c=int(interval(1,5))"], 60),
        (["a=1,2,3", "b=interval(0,1)"], None),
        (["a=tag(log,int(interval(1,5)))"], None),
    ],
)
def test_how_many_settings_there_are(words: list[str], count: int | None) -> None:
    assert space(*words).count() == count


def test_numbers_are_short_and_in_their_interval() -> None:
    assert rounded(0.123456789, FloatDistribution(0, 1)) == 0.1235
    assert rounded(1.23456e-5, FloatDistribution(1e-6, 1, log=True)) == 1.235e-5
    assert rounded(0.123412, FloatDistribution(0.12341, 1)) == 0.12341
    assert rounded(0.1 + 2 * 0.1, FloatDistribution(0.1, 1.0, step=0.1)) == 0.3

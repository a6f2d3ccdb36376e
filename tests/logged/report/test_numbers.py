"""Numbers as words."""

from __future__ import annotations

import math

import pytest

from credit.logged.report.numbers import interval, number, percent, short


@pytest.mark.parametrize(
    ("value", "words"),
    [(0, "0"), (1234567, "1,230,000"), (-0.5, "−0.500"), (0.0001234, "0.000123"), (1e-9, "1e−09"), (math.nan, "—")],
)
def test_a_number_has_digits_that_count(value: float, words: str) -> None:
    assert number(value) == words


def test_an_interval_says_how_many_digits_are_sure() -> None:
    assert interval(4.43812, 4.39511, 4.48113) == ("4.438", "4.395 to 4.481")
    assert interval(88478, 87621, 89335) == ("88,480", "87,620 to 89,340")
    assert interval(81.644312, 81.644310, 81.644314) == ("81.644", "81.644 to 81.644")  # no more than five
    assert interval(0.01, -0.2, 0.22) == ("0.01", "−0.20 to 0.22")
    assert interval(12.3456, math.nan, math.nan) == ("12.35", "")
    assert interval(math.nan, math.nan, math.nan) == ("—", "")


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.5, "50%"), (0.9999, "99.9%"), (1, "100%"), (0.004, "0.4%"), (0, "0%"), (-0.25, "−25%"), (math.nan, "—")],
)
def test_what_is_not_quite_all_is_not_said_to_be_all(share: float, words: str) -> None:
    assert percent(share) == words


def test_words_are_one_line_and_not_endless() -> None:
    assert short("a\nb  c") == "a b c"
    assert short("a" * 50, 10) == "a" * 9 + "…"
    assert short("") == "(empty)"

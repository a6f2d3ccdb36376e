"""Rank, relations that are named, contrasts that have no answer, and what would give one."""

from __future__ import annotations

import numpy as np
import pandas as pd

from credit.logged.fits.telling import WEAK, remedied, told
from credit.logged.panel import Part

DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")


def weekdays(lengths: list[int], spend: bool = True) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Design of rows and of windows: an intercept, six days against Monday, and a spend."""
    random = np.random.default_rng(0)
    days = np.concatenate([np.arange(n) for n in lengths]) % 7
    rows = np.column_stack([np.ones(len(days)), *(days == d for d in range(1, 7)), random.gamma(2, size=len(days))])
    starts = np.cumsum([0, *lengths[:-1]])
    return rows, np.add.reduceat(rows, starts, axis=0), ["Intercept", *(f"day[{d}]" for d in DAYS[1:]), "spend"]


def part(lengths: list[int]) -> Part:
    count = sum(lengths)
    return Part(pd.DataFrame(index=range(count)), np.repeat(np.arange(len(lengths)), lengths), np.zeros(count, int))


def test_day_of_week_in_whole_weeks_has_rank_one() -> None:
    _, x, names = weekdays([7] * 30)
    found = told(x.T @ x, names)
    assert found.rank == 2  # what all days have in common, and spend
    assert len(found.relations) == 6
    assert found.relations[0].text == "summed over every window, day[Sun] = 0.1429·Intercept"
    assert found.answers(np.eye(8)).tolist() == [False] * 7 + [True]
    week = np.array([7.0, 1, 1, 1, 1, 1, 1, 0])  # what a whole week is worth
    assert found.answers(week)
    assert found.answers(np.stack([week, week * 3, np.eye(8)[1] - np.eye(8)[2]])).tolist() == [True, True, False]
    assert np.isnan(found.inflation[:7]).all()
    assert found.inflation[7] < WEAK


def test_a_broken_week_settles_what_it_breaks() -> None:
    lengths = [7] * 30
    rows, x, names = weekdays(lengths)
    found = told(x.T @ x, names)
    advice = remedied(found.relations[0], part(lengths), rows, "week")
    assert "the first 6 of its 7 rows" in advice.remedy
    _, broken, _ = weekdays([7] * 15 + [6] + [7] * 14)  # Sunday is missing once, and the days behind it move
    again = told(broken.T @ broken, names)
    assert again.rank > found.rank


def test_columns_that_move_together_in_every_row_need_another_action() -> None:
    rows, _, _ = weekdays([7] * 30)
    both = np.column_stack([rows[:, [0, 7]], 2 * rows[:, 7]])
    x = np.add.reduceat(both, np.arange(0, 210, 7), axis=0)
    found = told(x.T @ x, ["Intercept", "tv", "radio"])
    assert [one.text for one in found.relations] == ["summed over every window, radio = 2·tv"]
    assert "another action" in remedied(found.relations[0], part([7] * 30), both, "week").remedy
    assert found.answers(np.array([[0, 1.0, 2], [0, 1, 0], [0, 2, -1]])).tolist() == [True, False, False]


def test_a_column_of_nothing_is_said_to_be_nothing() -> None:
    x = np.column_stack([np.full(20, 7.0), np.zeros(20), np.random.default_rng(0).normal(size=20)])
    found = told(x.T @ x, ["Intercept", "tv", "radio"])
    assert [one.text for one in found.relations] == ["tv is 0 in every window"]
    assert found.answers(np.eye(3)).tolist() == [True, False, True]


def test_a_column_that_is_nearly_another_is_inflated_and_has_it_as_partner() -> None:
    random = np.random.default_rng(0)
    x = np.column_stack([np.full(50, 7.0), random.normal(size=(50, 2))])
    x = np.column_stack([x, x[:, 1] + 0.01 * random.normal(size=50)])
    found = told(x.T @ x, ["Intercept", "tv", "radio", "web"])
    assert not found.relations
    np.testing.assert_allclose(found.inflation[1:], np.diag(np.linalg.inv(np.corrcoef(x[:, 1:].T))), rtol=1e-6)
    assert (found.inflation > WEAK).tolist() == [False, True, False, True]
    assert found.partner[[0, 1, 3]].tolist() == [-1, 3, 1]
    unit = x / np.sqrt((x**2).sum(0))
    np.testing.assert_allclose(found.condition, np.linalg.cond(unit), rtol=1e-6)

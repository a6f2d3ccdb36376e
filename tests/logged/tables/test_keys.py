from __future__ import annotations

import datetime
from typing import Any

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.panel import Roles
from credit.logged.tables.clock import Clock
from credit.logged.tables.keys import Runs, hashed, texts

from .tables import marketing

ROLES = Roles("week", "sales", "day", "region")


def runs(frame: pd.DataFrame, size: int) -> Runs:
    found = Runs(ROLES, Clock("day", "date"), "table")
    for first in range(0, len(frame), size):
        piece = frame.iloc[first : first + size].reset_index(drop=True)
        found.add(piece, np.arange(first, first + len(piece)))
    return found


@pytest.mark.parametrize("size", [1, 5, 7, 13, 1000])
def test_windows_do_not_depend_on_where_chunks_end(size: int) -> None:
    frame = marketing(days=24)
    found = runs(frame, size)
    assert found.ordered
    windows, first = found.finished()
    count = frame.groupby(["region", "week"]).size()
    assert windows.steps.tolist() == count.tolist()
    assert windows.id.tolist() == count.index.get_level_values("week").tolist()
    assert first.tolist() == [0, *np.cumsum(windows.steps)[:-1].tolist()]
    assert windows.time.tolist() == [0, 1, 2, 3] * 3


@pytest.mark.parametrize("size", [3, 1000])
def test_rows_out_of_order_are_seen(size: int) -> None:
    frame = marketing()
    assert not runs(frame.sort_values("day", kind="stable"), size).ordered  # groups come again
    back = frame.copy()
    back.loc[5, "day"] = pd.Timestamp("2023-01-01")
    assert not runs(back, size).ordered


@pytest.mark.parametrize("size", [1, 4, 1000])
def test_labels_that_differ_are_seen_over_chunks(size: int) -> None:
    frame = marketing()
    frame.loc[6, "sales"] += 1
    with pytest.raises(UserError, match="week 0 of region r0, which begins in row 0"):
        runs(frame, size).finished()


@pytest.mark.parametrize("size", [1, 4, 1000])
def test_equal_times_are_seen_over_chunks(size: int) -> None:
    frame = marketing()
    frame.loc[[5, 30], "day"] = [frame.day[4], frame.day[29]]
    assert runs(frame, size).tied().tolist() == [5, 30]


def test_keys_are_what_they_have_always_been() -> None:
    """A draw is keyed by them: other numbers would be other draws."""
    found = hashed(np.array([1, 2], dtype=object), np.array([0, 0]), ("north",))
    assert [hex(key) for key in found.tolist()] == GOLDEN


GOLDEN = ["0xd12d9751be9eb731", "0xee8d1a4f106c1b1c"]


def test_keys_belong_to_window_and_group_alone() -> None:
    ids, group = np.array([1, 2, 1, 2]), np.array([0, 0, 1, 1])
    found = hashed(ids, group, ("a", "b"))
    assert len({*found.tolist()}) == 4
    np.testing.assert_array_equal(found[2:], hashed(np.array([1.0, 2.0]), np.array([0, 0]), ("b",)))
    np.testing.assert_array_equal(found[:2], hashed(np.array(["1", "2"]), np.array([1, 1]), ("x", "a")))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3, 4], ["3", "4"]),
        ([3.0, 4.5], ["3", "4.5"]),
        (["a", "b"], ["a", "b"]),
        (pd.to_datetime(["2024-01-01", "2024-01-02"]), ["2024-01-01", "2024-01-02"]),
        (pd.to_datetime(["2024-01-01", "2024-01-02 06:00"], format="ISO8601"), ["2024-01-01", "2024-01-02 06:00:00"]),
        ([datetime.date(2024, 1, 1)], ["2024-01-01"]),
        ([pd.Timestamp("2024-01-01"), pd.Timestamp("2024-01-01 06:00")], ["2024-01-01", "2024-01-01 06:00:00"]),
    ],
)
def test_names_are_the_same_whatever_file_they_came_from(values: Any, expected: list[str]) -> None:
    assert texts(np.asarray(values)).tolist() == expected
    assert texts(np.array([*values], dtype=object)).tolist() == expected

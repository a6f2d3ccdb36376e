"""Passes over files as jobs: what comes of it is what one process finds, to the last bit."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.asking import Ask
from credit.logged.panel import Panel
from credit.logged.result import LoggedCredit
from credit.logged.spreading import spread_over
from credit.logged.tables.opening import opened
from tests.logged.test_recovering import ROLES, table

FORMULAS = {"reference": {"formula": "1 + adstock(x) + z"}, "surrogates": {"x": {"formula": "1 + x"}}}


def files(folder: Path, cuts: Sequence[int] = (200, 400)) -> str:
    """Rows of three groups of 200 as files, cut at these rows; the pattern that names them."""
    frame = table(groups=3)
    for number, (begin, end) in enumerate(zip([0, *cuts], [*cuts, len(frame)], strict=True)):
        frame.iloc[begin:end].to_parquet(folder / f"{number}.parquet", index=False)
    return str(folder / "*.parquet")


def elsewhere(calls: list[int]) -> Callable[[Callable[[Panel], Any], Sequence[Panel]], list[Any]]:
    """A runner whose jobs see what can be pickled alone; how many sections each pass had."""

    def run(function: Callable[[Panel], Any], sections: Sequence[Panel]) -> list[Any]:
        calls.append(len(sections))
        jobs = [pickle.dumps((function, section)) for section in sections]
        found = []
        for job in reversed(jobs):  # in whatever order
            one, section = pickle.loads(job)
            found.append(pickle.dumps(one(section)))
        return [pickle.loads(one) for one in reversed(found)]

    return run


@pytest.mark.parametrize("label_is", ["sum", "mean", "binary"])
def test_jobs_find_what_one_process_finds(tmp_path: Path, label_is: str) -> None:
    pattern = files(tmp_path)
    data: dict[str, Any] = {**ROLES, "label_is": label_is}
    if label_is == "binary":
        for path in tmp_path.glob("*.parquet"):
            rows = pd.read_parquet(path)
            rows.assign(y=(rows["y"] > 40).astype(int)).to_parquet(path, index=False)
    ask = Ask.of({"data": data, "draws": 12, **FORMULAS})
    panel = opened(pattern, data, memory=0)
    here = LoggedCredit.of(ask.fit(panel, ask.models(panel)))
    calls: list[int] = []
    with spread_over(elsewhere(calls)):
        there = LoggedCredit.of(ask.fit(panel, ask.models(panel)))
    assert set(calls) == {3}
    for name in ("steps", "windows", "effects", "told"):
        pd.testing.assert_frame_equal(getattr(here, name), getattr(there, name), rtol=0, atol=0)


def test_sections_are_windows_one_after_the_other(tmp_path: Path) -> None:
    panel = opened(files(tmp_path), ROLES, memory=0)
    sections = panel.sections()
    assert [section.first for section in sections] == [0, 40, 80]
    assert [len(section.windows) for section in sections] == [40, 40, 40]
    assert [section.windows.group[0] for section in sections] == [0, 1, 2]  # numbers of the whole table
    rows = pd.concat([part.frame for section in sections for part in section.parts()])
    whole = pd.concat([part.frame for part in panel.parts()])
    pd.testing.assert_frame_equal(rows, whole)


@pytest.mark.parametrize(("cut", "what"), [(202, "window 0"), (240, "group g1")])
def test_what_goes_on_in_the_next_file_is_named(tmp_path: Path, cut: int, what: str) -> None:
    panel = opened(files(tmp_path, (cut, 400)), ROLES, memory=0)
    with pytest.raises(UserError, match=rf"0\.parquet: {what} goes on in the next file.*whole groups into a file"):
        panel.sections()

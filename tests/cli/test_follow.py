"""What is said of a job when it ends."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from credit.cli.board import Board
from credit.cli.follow import line, table


def test_a_metric_that_is_no_number_is_said_to_be_none(tmp_path: Path) -> None:
    values = {"regret/share": float("nan"), "regret/cumulative": 12.25}
    counts = {"computed": 2, "skipped": 0, "resumed": 0, "seconds": 1.0}
    (tmp_path / "now").mkdir()
    board = Board(tmp_path)
    board.post(0, {"state": "ended", "status": "FINISHED", "title": "Mine", "values": values, **counts})
    said = line(board.read()[0], {"experiment": "sepsis"}, [], tmp_path / "job-0.log")
    assert said.endswith("Mine on sepsis: 2 seeds in 1.0 s. regret/share nan, regret/cumulative 12.25")


@pytest.mark.parametrize("title", ["a[/b]", "[v2] mine", "[red]not red", "loss $x_{$"])
def test_a_title_is_shown_as_it_is(tmp_path: Path, title: str) -> None:
    ended = {"state": "ended", "status": "FINISHED", "title": title, "values": {"a[b]": 1.0}}
    facts = {**ended, "computed": 1, "skipped": 0, "resumed": 0, "seconds": 1.0}
    config = {"experiment": "sepsis", "title": title, "seed": 0, "replicas": 1}
    failed = {**facts, "status": "FAILED", "error": "no [/x]"}
    shown = io.StringIO()
    console = Console(file=shown, width=200, highlight=False)
    for said in (facts, failed):
        console.print(line(said, config, [], tmp_path / "job-0.log"))
    console.print(table({0: facts}, {0: (config, [])}))
    assert shown.getvalue().count(title) == 3
    assert "a[b] 1" in shown.getvalue()

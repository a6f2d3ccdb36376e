"""What is said of a job when it ends."""

from __future__ import annotations

from pathlib import Path

from credit.cli.board import Board
from credit.cli.follow import line


def test_a_metric_that_is_no_number_is_said_to_be_none(tmp_path: Path) -> None:
    values = {"regret/share": float("nan"), "regret/cumulative": 12.25}
    counts = {"computed": 2, "skipped": 0, "resumed": 0, "seconds": 1.0}
    (tmp_path / "now").mkdir()
    board = Board(tmp_path)
    board.post(0, {"state": "ended", "status": "FINISHED", "title": "Mine", "values": values, **counts})
    said = line(board.read()[0], {"experiment": "sepsis"}, [], tmp_path / "job-0.log")
    assert said.endswith("Mine on sepsis: 2 seeds in 1.0 s. regret/share nan, regret/cumulative 12.25")

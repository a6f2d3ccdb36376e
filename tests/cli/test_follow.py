"""What is said of a job when it ends."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from credit.cli import follow
from credit.cli.board import Board
from credit.cli.outcome import Job, duration, line, table
from credit.runs.catalogue import progress_of


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


def ended(value: float, metric: str = "regret/cumulative") -> dict[str, Any]:
    counts = {"computed": 1, "skipped": 0, "resumed": 0, "seconds": 1.0}
    return {"state": "ended", "status": "FINISHED", "title": "Mine", "values": {metric: value}, **counts}


def shown(facts: dict[int, dict[str, Any]], jobs: dict[int, Job]) -> list[str]:
    text = io.StringIO()
    Console(file=text, width=200, highlight=False).print(table(facts, jobs))
    return [" ".join(row.split()) for row in text.getvalue().splitlines()]


def job(*words: str) -> Job:
    return {"experiment": "sepsis", "title": "Mine", "seed": 0, "replicas": 1}, ["method=mine", "replicas=1", *words]


def test_the_table_has_the_main_metric_and_what_differs_the_best_first() -> None:
    jobs = dict(enumerate([job("mixer.alpha=.1"), job("mixer.alpha=.2"), job("mixer.alpha=.3")]))
    rows = shown({0: ended(5.0), 1: ended(3.0), 2: {**ended(0.0), "status": "FAILED", "values": {}}}, jobs)
    assert rows[:2] == ["regret/", "job status method differs by cumulative seeds s"]
    assert rows[2:] == [
        "1 done Mine mixer.alpha=.2 3 0–0 1.0",
        "0 done Mine mixer.alpha=.1 5 0–0 1.0",
        "2 failed Mine mixer.alpha=.3 0–0 1.0",
    ]
    returns = shown(
        {0: ended(5.0, "eval/return"), 1: ended(3.0, "eval/return")}, {number: jobs[number] for number in (0, 1)}
    )
    assert [row.split()[0] for row in returns[2:]] == ["0", "1"]


def test_the_table_of_jobs_that_differ_by_method_alone_and_at_80_columns() -> None:
    rows = shown({0: ended(5.0), 1: ended(3.0)}, {0: job(), 1: job()})
    assert rows[1] == "job status method cumulative seeds s"
    jobs = {number: job(f"bonus.count.scale=0.{number}", "uncertainty.draws=20" * number) for number in (0, 1)}
    text = io.StringIO()
    Console(file=text, width=80, highlight=False).print(table({0: ended(5.0), 1: ended(3.0)}, jobs))
    assert max(map(len, text.getvalue().splitlines())) == 80
    assert "…" not in text.getvalue()


def test_a_log_is_told_now_and_then_how_far_all_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(follow, "SAID_EVERY", 0.0)
    (tmp_path / "now").mkdir()
    board, text = Board(tmp_path), io.StringIO()
    board.post(0, ended(5.0))
    board.post(1, {"state": "running", "title": "Mine", "steps": 10, "total": 40})
    jobs = {0: job("seed=0"), 1: job("seed=1")}
    with follow.Follower(board, jobs, Console(file=text, width=200, highlight=False)):
        pass
    said = text.getvalue().splitlines()
    assert said[0].startswith("done    Mine on sepsis (seed=0): 1 seeds in 1.0 s")
    assert said[1].startswith("running 1 of 2 jobs ended: 62%, ")


def test_a_job_whose_pace_is_known_says_when_it_ends() -> None:
    post = {"title": "Mine", "steps": 100, "total": 400, "since": {"steps": 0, "time": time.time() - 60}}
    left = progress_of(post).left
    assert left is not None
    assert duration(left) == "3 min 0 s"
    assert progress_of({**post, "since": None}).left is None

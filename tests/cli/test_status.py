"""`credit status` and `credit runs`: what lies in an output folder, seen from another terminal."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from credit.cli import status
from credit.cli.board import Board
from credit.cli.outcome import duration
from credit.runs import catalogue
from credit.runs.locks import Lock
from credit.runs.session import Session

SHORT = ("trainer.steps=70", "replicas=2", "tracking=none")


def begun(output: Path, argv: tuple[str, ...] = ("train", "-m", "seed=0,1")) -> Session:
    """A sweep of two jobs that this process is at."""
    session = Session.begin(output, "sweep", "advertiser", argv, None, [{"slug": "a"}, {"slug": "b"}])
    Board(session.folder).clear()
    return session


def test_a_command_that_runs_is_told_with_its_share_and_its_end(tmp_path: Path) -> None:
    session = begun(tmp_path)
    since = {"steps": 0, "time": time.time() - 60}
    facts = {"state": "running", "title": "Mine", "steps": 100, "total": 400, "since": since}
    Board(session.folder).post(1, facts)
    session.folder.joinpath("job-0.json").write_text(json.dumps({"status": "FINISHED"}))
    (found,) = catalogue.sessions(tmp_path)
    assert (found.status, found.jobs, found.ended) == ("running", 2, {"done": 1})
    first, second = status.lines(found)
    assert first.startswith("running")
    assert "2 jobs: 1 done" in first
    assert first.endswith("credit train -m seed=0,1")
    assert second.strip() == "Mine: 25% (100 of 400 steps, about 3 min 0 s left)"


def test_one_that_nobody_works_on_any_more_was_killed(tmp_path: Path) -> None:
    session = begun(tmp_path)
    session._lock.release()  # as its process dies
    (found,) = catalogue.sessions(tmp_path)
    assert found.status == "killed"
    assert found.seconds is None
    assert "the same command goes on with it" in status.lines(found)[-1]


def test_sessions_come_newest_first_and_damaged_ones_are_left_out(credit, folder: Path) -> None:
    for method in ("random", "reference"):
        credit("train", f"method={method}", *SHORT)
    (folder / "outputs/sessions/20200101-000000-dead").mkdir()
    (folder / "outputs/sessions/20200101-000000-dead/session.json").write_text('{"id": 3')
    ended = credit("status")
    assert ended.code == 0
    assert [line.split()[0] for line in ended.out.splitlines()] == ["done", "done"]
    newest = [session.id for session in catalogue.sessions(folder / "outputs")]
    assert newest == sorted(newest, reverse=True)
    assert len(credit("status", "last=1").out.splitlines()) == 1


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.4, "0 s"), (61, "1 min 1 s"), (3725, "1 h 2 min"), (90_000, "1 d 1 h")]
)
def test_durations(seconds: float, said: str) -> None:
    assert duration(seconds) == said


def test_runs_are_listed_by_job_and_filtered(credit, folder: Path) -> None:
    credit("train", "method=random", *SHORT)
    credit("train", "method=reference", *SHORT, "feedback.noise=.1")
    next(folder.rglob("random/*/seed-1/DONE")).unlink()
    lines = credit("runs").out.splitlines()
    assert lines[0].split()[:3] == ["experiment", "method", "variant"]
    assert lines[1].split()[:7] == ["advertiser", "random", "trainer.steps=70", "1", "of", "2", "unfinished"]
    row = lines[2]
    assert "feedback.noise=0.1,trainer.steps=70" in row
    assert "regret/cumulative" in row
    assert len(credit("runs", "method=ref*").out.splitlines()) == 2
    assert len(credit("runs", "status=done").out.splitlines()) == 2
    assert credit("runs", "method=oracle").code == 2
    refused = credit("runs", "status=finished")
    assert refused.code == 2
    assert "done, unfinished, running" in refused.err


def test_runs_are_deleted_only_with_a_filter_and_a_yes(credit, folder: Path) -> None:
    credit("train", "method=random", *SHORT)
    credit("train", "method=reference", *SHORT)
    for words in (("--delete",), ("--delete", "--yes"), ("--yes",), ("method=random", "--delete")):
        refused = credit("runs", *words)
        assert refused.code == 2
        assert len(list(folder.rglob("DONE"))) == 4
    assert credit("runs", "method=random", "--delete", "--yes").code == 0
    assert [path.parents[2].name for path in folder.rglob("DONE")] == ["reference"] * 2
    assert not (folder / "outputs/advertiser/random").exists()


def test_a_run_that_is_being_computed_is_not_deleted(credit, folder: Path) -> None:
    credit("train", "method=random", *SHORT)
    run = next(folder.rglob("seed-1"))
    lock = Lock(run / ".lock")
    assert lock.take()
    refused = credit("runs", "method=random", "--delete", "--yes")
    assert refused.code == 2
    assert "being computed" in refused.err
    assert len(list(folder.rglob("DONE"))) == 2
    lock.release()


def test_an_empty_folder_is_said_to_be_one(credit, folder: Path) -> None:
    for command in ("status", "runs"):
        refused = credit(command)
        assert refused.code == 2
        assert "output=outputs" in refused.err

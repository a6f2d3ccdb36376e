from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from mlflow import MlflowClient

from credit.runs.locks import Lock
from credit.tracking import MLflowTracking, NoTracking, Tracking, uploader
from credit.tracking.mirror import Mirror
from credit.tracking.report_run import log_report
from credit.tracking.sessions import State, pending

from .conftest import FakeSession


def statuses(uri: str) -> list[str]:
    client = MlflowClient(uri)
    runs = client.search_runs([experiment.experiment_id for experiment in client.search_experiments()])
    return sorted(run.info.status for run in runs)


def one_job(session: FakeSession) -> None:
    job = session.job("delayed", [0])
    job.header(["regret/cumulative"])
    job.row(7, (1,))
    job.end()


@pytest.mark.thorough
def test_a_process_follows_a_session_to_its_end(session: FakeSession, uri: str) -> None:
    tracking = MLflowTracking(uri)
    begin = time.monotonic()
    tracking.start(session.folder, session.output)
    assert time.monotonic() - begin < 1
    one_job(session)
    session.end()
    seen: list[tuple[int, int]] = []
    assert tracking.finish(timeout=60, on_progress=lambda done, total: seen.append((done, total))) is None
    assert seen[-1] == (2, 2), "one row of the job, one of its seed"
    assert statuses(uri) == ["FINISHED"] * 3
    assert (session.folder / "tracking.log").read_text() == ""


@pytest.mark.thorough
def test_the_death_of_the_trainer_ends_the_uploader(session: FakeSession, uri: str) -> None:
    one_job(session)
    state = uploader.upload(session.folder, session.output, uri, "auto", orphaned=lambda: True)
    assert (state.ended, state.problem) == (True, "")
    assert statuses(uri) == ["FINISHED", "FINISHED", "KILLED"], "the session itself was cut short"


def test_the_next_session_closes_what_a_power_cut_left_open(session: FakeSession, uri: str) -> None:
    one_job(session)
    State(uri, "auto").write(session.folder)
    Mirror(session.output, session.folder, uri).sync()
    assert "RUNNING" in statuses(uri)
    with Lock(session.folder / ".lock") as lock:
        assert lock.take()
        assert list(pending(session.output)) == [], "its command lives"
    assert list(pending(session.output)) == [session.folder]
    uploader.catch_up(session.output)
    assert list(pending(session.output)) == []
    assert statuses(uri) == ["FINISHED", "FINISHED", "KILLED"]


def test_two_uploaders_do_not_share_a_session(session: FakeSession, uri: str) -> None:
    with (
        uploader.alone_on(session.folder, wait=False) as first,
        uploader.alone_on(session.folder, wait=False) as second,
    ):
        assert (first, second) == (True, False)


def test_an_unreachable_server_costs_one_line(
    session: FakeSession, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(uploader, "POLL", 0.01)
    for name, value in {"MAX_RETRIES": "0", "TIMEOUT": "1"}.items():
        monkeypatch.setenv(f"MLFLOW_HTTP_REQUEST_{name}", value)
    one_job(session)
    session.end()
    nobody = "http://127.0.0.1:9"
    state = uploader.upload(session.folder, session.output, nobody, "auto", patience=0.1)
    assert state.problem == "ConnectionRefusedError: [Errno 111] Connection refused"
    assert state == State.read(session.folder)
    assert capsys.readouterr().err.count('Traceback (most recent call last):\n  File "' + str(uploader.__file__)) == 1


def test_a_stopped_uploader_says_how_to_go_on(session: FakeSession, uri: str) -> None:
    tracking = MLflowTracking(uri)
    tracking.start(session.folder, session.output)
    line = tracking.finish(timeout=0)
    assert line is not None
    assert "\n" not in line
    assert line.endswith(f"credit sync {session.output}")


@pytest.mark.parametrize("uri", [None, "sqlite:///a.db", "postgresql+psycopg://u:p@h/db", "http://127.0.0.1:5000"])
def test_addresses_that_are_allowed(uri: str | None, tmp_path: Path) -> None:
    assert MLflowTracking(uri).check(tmp_path) == []


@pytest.mark.parametrize("uri", ["", "nonsense", "file:///tmp/mlruns", "sqlite:///", "ftp://host", "./mlruns"])
def test_addresses_that_are_not(uri: str, tmp_path: Path) -> None:
    (problem,) = MLflowTracking(uri).check(tmp_path)
    assert problem.startswith(f"tracking.uri={uri!r}")
    assert "sqlite:///" in problem
    assert not list(tmp_path.iterdir())


def test_no_tracking_does_nothing(session: FakeSession) -> None:
    tracking: Tracking = NoTracking()
    assert tracking.check(session.output) == []
    tracking.start(session.folder, session.output)
    assert tracking.finish() is None
    assert [path.name for path in session.folder.iterdir()] == ["session.json"]


def test_the_trainer_does_not_pay_for_mlflow() -> None:
    code = "import sys, credit.tracking; print(*{'mlflow', 'torch', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_report_is_a_run_of_its_own(tmp_path: Path, uri: str) -> None:
    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "table.md").write_text("| a |")
    identity = log_report(tmp_path, uri, "advertiser", folder, {"reference/iqm (95%)": 1.0, "nothing": float("nan")})
    client = MlflowClient(uri)
    run = client.get_run(identity)
    assert (run.info.run_name, run.info.status, run.data.tags["level"]) == ("compare", "FINISHED", "report")
    assert run.data.tags["mlflow.source.name"] == "credit compare experiment=advertiser"
    assert run.data.tags["mlflow.user"]
    assert run.data.metrics == {"report/reference_iqm _95__": 1.0}
    assert [file.path for file in client.list_artifacts(identity)] == ["table.md"]


@pytest.mark.slow
def test_a_fresh_store_is_made_once(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from credit.tracking.store import *;"
        "print(open_experiment(resolve_uri(None, Path(sys.argv[1])), Path(sys.argv[1]), 'x')[1])"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    assert {process.communicate()[0].strip() for process in processes} == {"1"}

"""Stores that are gone, full or talking nonsense while a run goes on, and `credit sync` afterwards."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from credit.bench.servers import Server
from credit.cli.main import main
from credit.runs.locks import Lock
from credit.tracking import MLflowTracking, uploader
from credit.tracking.sessions import State, pending

from .conftest import FakeSession
from .reading import all_runs, assert_equal_to_journals

ROWS = 12


class Run:
    """A run that writes a row now and then, as a trainer does, with an uploader beside it."""

    def __init__(self, folder: Path, uri: str):
        self.session = FakeSession(folder / "outputs")
        self.lock = Lock(self.session.folder / ".lock")
        assert self.lock.take()
        self.tracking = MLflowTracking(uri)
        self.tracking.start(self.session.folder, self.session.output)
        self.job = self.session.job("delayed", [0, 1, 2])
        self.job.header(["return/label", "reward/mse", "time/seconds"])
        self.step = 0

    def rows(self, count: int = ROWS) -> None:
        for _ in range(count):
            self.step += 7
            self.job.row(self.step, *([self.step / (seed + 3), 1 / self.step, self.step / 2] for seed in range(3)))
            time.sleep(0.05)

    def end(self) -> str | None:
        self.job.end()
        self.session.end()
        self.lock.release()
        begin = time.monotonic()
        line = self.tracking.finish(timeout=60)
        assert line is None or time.monotonic() - begin < 11
        return line

    def wait_for(self, seen: Callable[[State], bool]) -> None:
        end = time.monotonic() + 60
        while not ((state := State.read(self.session.folder)) and seen(state)):
            assert time.monotonic() < end, state
            time.sleep(0.1)

    def news(self) -> str:
        end = time.monotonic() + 30
        while (line := self.tracking.news()) is None:
            assert time.monotonic() < end
            time.sleep(0.1)
        return line


def check(run: Run, uri: str, rows: int, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Everything is in the store, once; a sync by name finds nothing to do."""
    assert assert_equal_to_journals(uri, run.session.output) == 3 * rows
    assert {run.info.status for level in ("sweep", "job", "seed") for run in all_runs(uri, level)} == {"FINISHED"}
    capsys.readouterr()
    assert main(["sync", str(run.session.output)]) == 0
    assert "nothing to upload" in capsys.readouterr().out
    assert main(["sync", str(run.session.folder)]) == 0
    assert f"{4 * rows} rows in {uri}, 0 of them new" in capsys.readouterr().out


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    server = Server(f"sqlite:///{tmp_path / 'server.db'}", tmp_path)
    yield server
    server.stop()


@pytest.mark.slow
def test_a_server_that_stops_and_comes_back(tmp_path: Path, server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    server.start()
    run = Run(tmp_path, server.uri)
    run.rows()
    run.wait_for(lambda state: state.done == 4 * ROWS)
    server.stop()
    run.rows()
    assert server.uri in run.news()
    assert run.tracking.news() is None, "once"
    server.start()
    run.rows()
    run.wait_for(lambda state: state.since is None)
    assert run.end() is None
    check(run, server.uri, 3 * ROWS, tmp_path, capsys)


@pytest.mark.slow
def test_a_server_that_starts_after_the_run(tmp_path: Path, server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    run = Run(tmp_path, server.uri)
    run.rows()
    line = run.end()
    assert line is not None
    assert line.endswith(f"credit sync {run.session.output}")
    assert main(["sync", str(run.session.output)]) == 1
    assert f"{server.uri} does not take the metrics" in capsys.readouterr().err
    server.start()
    assert main(["sync", str(run.session.output)]) == 0
    assert f"{4 * ROWS} of them new" in capsys.readouterr().out
    check(run, server.uri, ROWS, tmp_path, capsys)


@pytest.mark.slow
def test_the_next_command_uploads_what_an_outage_left(
    tmp_path: Path, server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(tmp_path, server.uri)
    run.rows()
    assert run.end() is not None
    server.start()
    later = FakeSession(run.session.output, identifier="20261123-000000-0000")
    tracking = MLflowTracking(server.uri)
    tracking.start(later.folder, later.output)
    later.end()
    assert tracking.finish(timeout=30) is None
    while list(pending(run.session.output)):
        time.sleep(0.1)
    check(run, server.uri, ROWS, tmp_path, capsys)


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A file system of 4 MiB, and a file that fills it."""
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)], capture_output=True)
    if done.returncode:
        pytest.skip(f"a small tmpfs cannot be mounted here: {done.stderr.decode().strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(disk: Path) -> None:
    with (disk / "filler").open("wb", buffering=0) as file:
        for size in (2**16, 2**12, 1):
            try:
                while file.write(b"x" * size) == size:
                    pass
            except OSError:
                continue


@pytest.mark.slow
@pytest.mark.parametrize("freed", ["in the run", "after the run", "full from the start"])
def test_a_full_disk_under_the_store(tmp_path: Path, capsys: pytest.CaptureFixture[str], freed: str) -> None:
    with small_disk(tmp_path / "disk") as disk:
        uri = f"sqlite:///{disk / 'mlflow.db'}"
        if freed == "full from the start":
            fill(disk)
        run = Run(tmp_path, uri)
        run.rows()
        if freed != "full from the start":
            run.wait_for(lambda state: state.done == 4 * ROWS)
            fill(disk)
        run.rows(600)
        assert "full" in run.news()
        if freed == "in the run":
            (disk / "filler").unlink()
            run.wait_for(lambda state: state.since is None)
            assert run.end() is None
        else:
            line = run.end()
            assert line is not None
            assert "full" in line
            (disk / "filler").unlink()
            assert main(["sync", str(run.session.output)]) == 0
        check(run, uri, ROWS + 600, tmp_path, capsys)


class Rubbish(BaseHTTPRequestHandler):
    kind = ""

    def do_GET(self) -> None:
        if self.kind == "closes":
            return
        if self.kind == "silent":
            time.sleep(5)
            return
        status, kind, text = {
            "500": (500, "text/plain", "Internal Server Error"),
            "404": (404, "text/html", "<html>nginx</html>"),
            "html": (200, "text/html", "<html>Log in</html>"),
            "empty": (200, "application/json", ""),
            "other json": (200, "application/json", '{"run": {"info": 3}, "experiment": []}'),
        }[self.kind]
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text.encode())

    do_POST = do_GET

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["500", "404", "html", "empty", "other json", "closes", "silent"])
def test_an_address_that_answers_rubbish(
    session: FakeSession, uri: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """It is said, quickly, and nothing is taken for uploaded."""
    monkeypatch.setattr("credit.cli.sync.SECONDS", 0.0)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_TIMEOUT", "1")
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    httpd = ThreadingHTTPServer(("127.0.0.1", 0), type("Kind", (Rubbish,), {"kind": kind}))
    threading.Thread(target=httpd.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    address = f"http://127.0.0.1:{httpd.server_address[1]}"
    job = session.job("delayed", [0])
    job.header(["return/label"])
    job.row(7, (1,))
    job.end()
    session.end()
    State(address, "auto").write(session.folder)
    begin = time.monotonic()
    try:
        assert main(["sync", str(session.output)]) == 1
    finally:
        httpd.shutdown()
        httpd.server_close()
    assert time.monotonic() - begin < 10
    error = capsys.readouterr().err
    assert f"credit sync: {address} does not take the metrics: " in error
    assert "Nothing is lost" in error
    assert list(pending(session.output)) == [session.folder]
    State(uri, "auto").write(session.folder)
    assert uploader.upload(session.folder, session.output, uri, "auto").problem == ""
    assert assert_equal_to_journals(uri, session.output) == 1
    assert os.environ["MLFLOW_HTTP_REQUEST_TIMEOUT"] == "1"

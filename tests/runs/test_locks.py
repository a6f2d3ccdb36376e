"""A lock is one process's, for as long as it lives."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from credit.runs.locks import Lock


def hold(path: Path, end: Connection) -> None:
    """Say whether the lock could be taken, and keep it until told to let go."""
    lock = Lock(path)
    end.send(lock.take())
    end.recv()
    lock.release()
    end.send(None)
    end.recv()


@pytest.fixture
def other(tmp_path: Path) -> Iterator[tuple[Any, Connection]]:
    """Another process that tries to take the lock, and our end of the line to it."""
    here, there = multiprocessing.get_context("fork").Pipe()
    process = multiprocessing.get_context("fork").Process(target=hold, args=(tmp_path / ".lock", there))
    process.start()
    yield process, here
    process.kill()
    process.join()


def test_a_lock_is_held_by_one_process_until_it_lets_go(tmp_path, other):
    process, line = other
    assert line.recv()
    mine = Lock(tmp_path / ".lock")
    assert not mine.take()
    assert mine.held_elsewhere()
    assert f"process {process.pid} on " in mine.holder()
    line.send("let go")
    line.recv()
    assert not mine.held_elsewhere()
    assert mine.take()
    assert f"process {os.getpid()} on " in mine.holder()


def test_a_lock_ends_with_a_process_that_is_killed(tmp_path, other):
    process, line = other
    assert line.recv()
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    with Lock(tmp_path / ".lock") as mine:
        assert mine.take()


def test_the_other_process_waits_for_us(tmp_path):
    path = tmp_path / ".lock"
    with Lock(path) as mine:
        assert mine.take()
        assert mine.take()
        assert not mine.held_elsewhere()
        assert not Lock(path).take()
        assert Lock(path).held_elsewhere()
    assert Lock(path).take()
    assert path.exists()


def test_nobody_holds_what_is_not_there(tmp_path):
    lock = Lock(tmp_path / ".lock")
    assert not lock.held_elsewhere()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["", "{", "[]", json.dumps({"pid": 3})])
def test_a_holder_who_could_not_write_a_name(tmp_path, text):
    (tmp_path / ".lock").write_text(text)
    assert Lock(tmp_path / ".lock").holder() == "another process"

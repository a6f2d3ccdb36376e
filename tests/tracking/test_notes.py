"""Whose MLflow run a folder has: decided by one at a time."""

from __future__ import annotations

import threading
from pathlib import Path

from credit.tracking.notes import one_at_a_time


def test_one_at_a_time(tmp_path: Path) -> None:
    entered = threading.Event()

    def other() -> None:
        with one_at_a_time(tmp_path):
            entered.set()

    thread = threading.Thread(target=other)
    with one_at_a_time(tmp_path):
        thread.start()
        assert not entered.wait(0.2)
    assert entered.wait(10)
    thread.join()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with one_at_a_time(tmp_path / "none"):
        entered = True
    assert entered
    assert not (tmp_path / "none").exists()

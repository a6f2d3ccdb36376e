"""Output that fails ends no run: readers that go away, full disks, terminals without our characters."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from credit.cli.output import Surviving, fitted, surviving

RUN = ["method=delayed", "trainer.steps=70", "replicas=1", "tracking=none"]


def command(folder: Path, *words: str, **keys: Any) -> subprocess.CompletedProcess[bytes]:
    whole = [sys.executable, "-m", "credit.cli.main", *words]
    return subprocess.run(whole, cwd=folder, stderr=subprocess.PIPE, check=False, timeout=300, **keys)


def nobody() -> int:
    """The end of a pipe that nobody reads."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize("where", [nobody, lambda: os.open("/dev/full", os.O_WRONLY)], ids=["no reader", "no room"])
def test_a_run_ends_well_whoever_reads(tmp_path: Path, where: Callable[[], int]) -> None:
    ended = command(tmp_path, "train", *RUN, stdout=where())
    assert (ended.returncode, b"Error" in ended.stderr) == (0, False), ended.stderr
    assert len([*tmp_path.rglob("DONE")]) == 1


@pytest.mark.parametrize("closed", [(1,), pytest.param((1, 2), marks=pytest.mark.thorough), (2,)])
def test_a_run_ends_well_with_streams_that_are_closed(tmp_path: Path, closed: tuple[int, ...]) -> None:
    """And no file of a run takes their places."""
    places = " ".join(f"{number}>&-" for number in closed)
    words = ["sh", "-c", f'exec "$@" {places}', "sh", sys.executable, "-m", "credit.cli.main", "train", *RUN]
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, check=False, timeout=300)
    assert (ended.returncode, b"Error" in ended.stdout + ended.stderr) == (0, False), ended.stderr
    assert len([*tmp_path.rglob("DONE")]) == 1


@pytest.mark.parametrize(("encoding", "said"), [("ascii", b"sqrt "), ("latin-1", b"sqrt "), ("utf-8", "√".encode())])
def test_characters_that_a_terminal_lacks_are_replaced(tmp_path: Path, encoding: str, said: bytes) -> None:
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    ended = command(tmp_path, "list", "bonus", stdout=subprocess.PIPE, env=environment)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert said in ended.stdout


def test_what_is_not_known_is_a_question_mark() -> None:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii", errors="plainly")
    stream.write("39 ± 7, 日")
    stream.flush()
    assert raw.getvalue() == b"39 +/- 7, ?"


def test_a_stream_that_broke_stays_silent() -> None:
    stream = os.fdopen(nobody(), "w")
    for _ in range(2):
        assert Surviving(stream).write("x" * 100_000) == 100_000
        Surviving(stream).flush()
    assert os.readlink(f"/proc/self/fd/{stream.fileno()}") == os.devnull
    stream.close()


def test_streams_are_what_they_were_afterwards() -> None:
    before = sys.stdout, sys.stderr
    with surviving():
        assert sys.stdout is not before[0]
        assert sys.stdout.isatty() == before[0].isatty()
    assert (sys.stdout, sys.stderr) == before


LONG = "  agent       ValueIteration: Dynamic programming on counts, solved exactly by warm-started policy iteration."


def test_at_a_terminal_lines_are_as_wide_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    assert fitted(LONG).splitlines() == [
        "  agent       ValueIteration: Dynamic programming on counts,",
        "              solved exactly by warm-started policy",
        "              iteration.",
    ]
    assert fitted("short") == "short"
    assert fitted("") == ""
    assert max(map(len, fitted("key = " + "a, " * 40).splitlines())) <= 60
    assert fitted("x" * 70) == "x" * 70  # what has no spaces is not broken


def test_in_a_pipe_lines_are_whole_for_those_who_search_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: False, raising=False)
    assert fitted(LONG) == LONG

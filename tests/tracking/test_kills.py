"""Commands and uploaders that end by SIGKILL, and the same command again."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from credit.tracking.sessions import pending
from credit.tracking.store import resolve_uri

from .reading import all_runs, assert_equal_to_journals

COMMAND = ("-m", "method=random,delayed,reference", "replicas=3", "trainer.steps=14000", "trainer.log_every=40")


def train(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    with (folder / "terminal.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "credit.cli.main", "train", *words], cwd=folder, stdout=log, stderr=log
        )


def uploader_of(process: subprocess.Popen[bytes]) -> psutil.Process | None:
    for child in psutil.Process(process.pid).children():
        with suppress(psutil.NoSuchProcess):  # a child that has just ended
            if "credit.tracking.uploader" in child.cmdline():
                return child
    return None


def settle(output: Path) -> None:
    """Uploaders outlive their command where there is something left of earlier sessions."""
    end = time.monotonic() + 60
    while list(pending(output)):
        assert time.monotonic() < end, list(pending(output))
        time.sleep(0.2)


@pytest.mark.slow
@pytest.mark.parametrize("victims", ["both", "trainer", "uploader"])
def test_killed_at_random_and_typed_again(tmp_path: Path, victims: str) -> None:
    moments = random.Random(victims)
    output = tmp_path / "outputs"
    for _ in range(3):
        process = train(tmp_path, *COMMAND)
        until = time.monotonic() + 3 + 6 * moments.random()
        while time.monotonic() < until and process.poll() is None:
            time.sleep(0.05)
        if process.poll() is not None:
            break
        uploader = uploader_of(process)
        if uploader is not None and victims != "trainer":
            os.kill(uploader.pid, signal.SIGKILL)
        if victims != "uploader":
            process.kill()
        process.wait()
    last = train(tmp_path, *COMMAND)
    assert last.wait(120) == 0
    settle(output)
    uri = resolve_uri(None, output)
    assert assert_equal_to_journals(uri, output, exact_times=False) > 0
    levels = ("sweep", "job", "seed")
    statuses = {run.info.run_name: run.info.status for level in levels for run in all_runs(uri, level)}
    assert set(statuses.values()) == {"FINISHED"}, statuses
    assert len(all_runs(uri, "seed")) == 9
    assert len(all_runs(uri, "job")) == 3


@pytest.mark.slow
def test_a_wider_command_goes_on_with_killed_seeds(tmp_path: Path) -> None:
    """And marks the killed session's own runs while it runs."""
    output = tmp_path / "outputs"
    narrow = ("method=disagreement", "trainer.steps=70000", "trainer.log_every=100")
    process = train(tmp_path, *narrow, "replicas=2")
    end = time.monotonic() + 60
    while not list(output.glob("advertiser/*/*/seed-*/mlflow.json")):
        assert time.monotonic() < end
        time.sleep(0.1)
    uploader = uploader_of(process)
    assert uploader is not None
    uploader.kill()
    process.kill()
    process.wait()
    uri = resolve_uri(None, output)
    begun = {run.data.tags["seed"]: run.info.run_id for run in all_runs(uri, "seed")}
    assert begun
    assert train(tmp_path, *narrow, "replicas=3").wait(200) == 0
    settle(output)
    assert assert_equal_to_journals(uri, output, exact_times=False) > 0
    seeds = {run.data.tags["seed"]: run for run in all_runs(uri, "seed")}
    assert {run.info.status for run in seeds.values()} == {"FINISHED"}
    assert all(seeds[seed].info.run_id == identity for seed, identity in begun.items())
    jobs = sorted((run.data.tags["session"], run.info.status) for run in all_runs(uri, "job"))
    assert [status for _, status in jobs] == ["KILLED", "FINISHED"]

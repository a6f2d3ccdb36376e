"""Commands that are interrupted, gone on with, or typed twice, each in a process of its own."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import credit as package
from credit.runs.session import Session

ROOT = Path(package.__file__).resolve().parents[1]
WORDS = ("method=disagreement", "replicas=2", "trainer.steps=1400", "checkpoint_seconds=0", "tracking=none")
PLACE = "advertiser/disagreement/trainer.steps=1400"
PATIENCE = 60.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: Any) -> dict[str, Any]:
    """What undisturbed runs leave."""
    folder = tmp_path_factory.mktemp("whole")
    package.run([*WORDS, f"output={folder}"])
    return results(folder / PLACE)


def results(parent: Path) -> dict[str, Any]:
    found = {}
    for file in sorted(parent.glob("seed-*/metrics.csv")):
        with file.open() as rows:
            found[file.parent.name] = [
                {key: cell for key, cell in row.items() if key != "time/seconds"} for row in csv.DictReader(rows)
            ]
        assert (file.parent / "DONE").exists()
        assert not list(file.parent.glob("*checkpoint*"))
    return found


@pytest.fixture
def begin(folder: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """A command that runs beside the test."""
    begun = []

    def command(*words: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "credit.cli.main", *words],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        begun.append(process)
        return process

    yield command
    for process in begun:
        process.kill()
        process.communicate()


def until(there: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not there():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.005)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "resumed_by"), [(signal.SIGTERM, "resume"), pytest.param(signal.SIGINT, "train", marks=pytest.mark.slow)]
)
def test_a_signal_ends_a_run_with_a_checkpoint(begin, credit, folder, whole, number, resumed_by):
    words = [word.replace("seconds=0", "seconds=60") for word in WORDS]
    process = begin("train", *words)
    until(lambda: list(folder.glob(f"outputs/{PLACE}/seed-*/metrics.csv")))
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert said.count("stopping after this round, with a checkpoint") == (number == signal.SIGINT)
    assert said.count("interrupted; the same command goes on with it") == 1
    assert "interrupted" in said
    assert "Traceback" not in said
    assert (folder / "outputs" / PLACE / "seed-0" / "checkpoint.pt").exists()
    session = next((folder / "outputs/sessions").iterdir())
    assert {json.loads(file.read_text())["status"] for file in session.glob("*.json")} == {"KILLED"}
    again = credit("train", *words) if resumed_by == "train" else credit("resume", f"outputs/{PLACE}/seed-1")
    assert again.code == 0
    assert results(folder / "outputs" / PLACE) == whole
    finished = credit("resume", "outputs")
    assert (finished.code, finished.out) == (0, "all runs were done before\n")


@pytest.mark.thorough
def test_a_killed_run_goes_on(begin, credit, folder, whole):
    process = begin("train", *WORDS)
    until(lambda: list(folder.glob(f"outputs/{PLACE}/seed-*/checkpoint.pt")))
    running = credit("resume", "outputs")
    assert running.code == 2
    assert f"is being computed by process {process.pid} on " in running.err
    assert "wait for it, or stop it first" in running.err
    process.kill()
    process.wait()
    ended = credit("resume", "outputs")
    assert ended.code == 0
    assert "2 seeds, 2 of them resumed" in ended.out
    assert results(folder / "outputs" / PLACE) == whole


@pytest.mark.slow
def test_two_commands_at_once_compute_every_run_once(begin, folder, whole):
    processes = [begin("train", *WORDS) for _ in range(2)]
    said = [process.communicate(timeout=PATIENCE)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], said
    assert sum("2 seeds in" in text for text in said) == 1, said
    assert sum("all 2 seeds were done before" in text for text in said) == 1, said
    assert "Traceback" not in "".join(said)
    assert results(folder / "outputs" / PLACE) == whole


@pytest.mark.slow
def test_a_sweep_goes_on_from_the_folder_of_its_session(begin, credit, folder):
    short = ("replicas=1", "trainer.steps=700", "checkpoint_seconds=0", "tracking=none")
    process = begin("train", "-m", "method=reference,delayed,random", *short)
    until(lambda: list(folder.glob("outputs/advertiser/*/*/seed-*/checkpoint.pt")))
    process.kill()
    process.wait()
    session = next((folder / "outputs/sessions").iterdir())
    assert not (session / "job-2.json").exists()
    ended = credit("resume", str(session))
    assert ended.code == 0, ended.err
    done = sorted(file.parents[2].name for file in folder.glob("outputs/advertiser/*/*/seed-0/DONE"))
    assert done == ["delayed", "random", "reference"]
    assert [path.name for path in (folder / "outputs/sessions").iterdir()] == [session.name]
    assert {json.loads(file.read_text())["status"] for file in session.glob("*.json")} == {"FINISHED"}


def test_what_cannot_be_resumed(credit, folder):
    (folder / "empty").mkdir()
    for words, expected in (
        (("empty",), "empty: no run lies here or below"),
        (("nowhere",), "nowhere: no such folder"),
        ((), "one folder is needed, got none"),
        (("one", "two"), "one folder is needed, got ['one', 'two']"),
    ):
        ended = credit("resume", *words)
        assert ended.code == 2
        assert expected in ended.err
    assert [path.name for path in folder.iterdir()] == ["empty"]
    session = Session.begin(folder, "job", "advertiser", ["train", "method=delayed"], None, [])
    ended = credit("resume", str(session.folder))
    assert ended.code == 2
    assert "`credit train method=delayed` is still at work (process " in ended.err
    session.finish("FINISHED")
    assert credit("resume", "--help").out.startswith("usage: credit resume DIR")


def test_a_signal_in_the_last_round_lets_no_other_job_begin(folder, monkeypatch):
    """The run is done by then; the sweep that it belongs to is not."""
    from credit.trainer import Trainer

    learn = Trainer._learn

    def last(trainer: Trainer, *experience: Any, **how: Any) -> None:
        learn(trainer, *experience, **how)
        if trainer.collected == 20:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Trainer, "_learn", last)
    with pytest.raises(KeyboardInterrupt):
        package.run(["method=random", "replicas=1", "trainer.steps=140", "tracking=none"], signals=True)
    assert len(list(folder.rglob("DONE"))) == 1
    assert not list(folder.rglob("*checkpoint*"))


def test_a_session_is_gone_on_with_in_a_folder_of_any_name(credit, folder, monkeypatch):
    odd = folder / "q?x a%20b,c[1]=ü {a: 1}#;&"
    odd.mkdir()
    monkeypatch.chdir(odd)
    assert credit("train", "method=random", "replicas=1", "trainer.steps=70", "tracking=none").code == 0
    (session,) = (odd / "outputs" / "sessions").iterdir()
    ended = credit("resume", str(session))
    assert (ended.code, [path.name for path in folder.iterdir()]) == (0, [odd.name]), ended.err
    assert "all 1 seeds were done before" in ended.err

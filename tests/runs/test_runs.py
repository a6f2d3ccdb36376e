"""Run folders: what is done, what goes on, and what is left alone."""

from __future__ import annotations

import csv
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

import credit
from credit.core.errors import UserError
from credit.runs import checkpoint, folders, resume, work
from credit.runs.journal import Journal
from credit.runs.locks import Lock
from credit.runs.session import Session

WORDS = ("method=reference", "trainer.steps=280", "trainer.log_every=5")
PLACE = "outputs/advertiser/reference/trainer.log_every=5,trainer.steps=280"
HALF = 147  # steps, of 280
SEEDS = (0, 1, 2, 3)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: Any) -> Path:
    """Four undisturbed runs."""
    folder = tmp_path_factory.mktemp("whole")
    credit.run([*WORDS, "replicas=4", "tracking=none", f"output={folder / 'outputs'}"])
    return Path(folder)


@pytest.fixture(scope="module")
def half(tmp_path_factory: Any, interrupt: Callable[..., None]) -> Path:
    """The same four, interrupted in the middle."""
    folder = tmp_path_factory.mktemp("half")
    interrupt(HALF, *WORDS, "replicas=4", f"output={folder / 'outputs'}")
    return Path(folder)


@pytest.fixture
def folder(tmp_path: Path, half: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the interrupted runs, to work in."""
    shutil.copytree(half, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path / PLACE


def go_on(*words: str) -> credit.Result:
    return credit.run([*WORDS, "tracking=none", *words])


def found(*words: str) -> folders.Folders:
    return folders.find(credit.compose([*WORDS, "tracking=none", *words]), Path(PLACE).resolve())


def rows(parent: Path, seed: int, times: bool = False) -> list[dict[str, str]]:
    with (parent / f"seed-{seed}" / "metrics.csv").open() as file:
        return [{key: row[key] for key in row if times or key != "time/seconds"} for row in csv.DictReader(file)]


def test_an_interrupted_group_goes_on_and_equals_an_undisturbed_one(folder, whole):
    ended = go_on("replicas=4")
    assert (ended.resumed, ended.computed, ended.skipped) == ([0, 1, 2, 3], [0, 1, 2, 3], [])
    for seed in SEEDS:
        assert rows(folder, seed) == rows(whole / PLACE, seed)
        assert not list((folder / f"seed-{seed}").glob("*checkpoint*"))
    again = go_on("replicas=4")
    assert (again.resumed, again.computed, again.skipped) == ([], [], [0, 1, 2, 3])


def test_a_group_goes_on_as_a_whole_though_less_was_asked_for(folder, whole):
    ended = go_on("seed=2", "replicas=1")
    assert ended.resumed == [0, 1, 2, 3]
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)


def test_more_is_asked_for_than_was_interrupted(folder, whole):
    ended = go_on("seed=3", "replicas=2")
    assert (ended.resumed, ended.computed) == ([0, 1, 2, 3], [0, 1, 2, 3, 4])
    assert rows(folder, 3) == rows(whole / PLACE, 3)


def test_killed_between_two_done(folder, whole, monkeypatch):
    write = work.write_atomically

    def killed(path: Path, text: str) -> None:
        if path.parent.name == "seed-2" and path.name == "DONE":
            raise KeyboardInterrupt
        write(path, text)

    monkeypatch.setattr(work, "write_atomically", killed)
    with pytest.raises(KeyboardInterrupt):
        go_on("replicas=4")
    monkeypatch.undo()
    monkeypatch.chdir(folder.parents[3])
    files = [folder / f"seed-{seed}" / "metrics.csv" for seed in (0, 1)]
    before = [(file.stat().st_mtime_ns, file.read_bytes()) for file in files]
    now = found("replicas=4")
    assert now.done == (0, 1)
    assert now.groups == (folders.Group((0, 1, 2, 3), (2, 3), folder / "seed-0" / checkpoint.NAME),)
    ended = go_on("replicas=4")
    assert (ended.resumed, ended.skipped) == ([2, 3], [0, 1])
    assert [(file.stat().st_mtime_ns, file.read_bytes()) for file in files] == before
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)
    assert not list(folder.rglob("*checkpoint*"))


def test_of_two_checkpoints_the_newest_wins(folder, whole, interrupt):
    interrupt(196, *WORDS, "seed=1", "replicas=2", "rerun=true")
    old, new = (folder / f"seed-{seed}" / checkpoint.NAME for seed in (0, 1))
    os.utime(old, (1e9, 1e9))
    assert found("replicas=4").groups == (folders.Group((1, 2), (1, 2), new), folders.Group((0, 1, 2, 3), (0, 3), old))
    os.utime(new, (1e8, 1e8))
    assert found("replicas=4").groups == (folders.Group((0, 1, 2, 3), (0, 1, 2, 3), old),)
    os.utime(old, (1e7, 1e7))
    assert go_on("replicas=4").resumed == [1, 2, 0, 3]
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)


def test_a_checkpoint_of_another_configuration_is_refused(folder):
    for seed in SEEDS:
        (folder / f"seed-{seed}" / "config.yaml").unlink()
    file = folder / "seed-0" / checkpoint.NAME
    content = checkpoint.load(file)
    content["config"]["env"]["p_up"] = 0.9
    checkpoint.save(file, content | {"config_hash": "0"})
    with pytest.raises(UserError, match=r"checkpoint\.pt: the checkpoint is of another configuration: env\.p_up: 0\.9"):
        go_on("replicas=4")
    assert go_on("replicas=4", "rerun=true").computed == [0, 1, 2, 3]
    assert not file.exists()


def test_rerun_ignores_and_removes_checkpoints(folder, whole):
    (folder / "seed-0" / f".{checkpoint.NAME}").write_bytes(b"half")
    ended = go_on("replicas=4", "rerun=true")
    assert (ended.resumed, ended.computed) == ([], [0, 1, 2, 3])
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)
    assert not list(folder.rglob("*checkpoint*"))


def test_a_checkpoint_whose_run_finishes_while_it_is_looked_for(folder, monkeypatch):
    load = checkpoint.load

    def gone(path: Path, *device: Any) -> Any:
        path.unlink()
        return load(path, *device)

    monkeypatch.setattr(checkpoint, "load", gone)
    assert found("replicas=4").groups == (folders.Group((0, 1, 2, 3), (0, 1, 2, 3)),)


def test_a_finished_group_is_not_looked_into(folder):
    go_on("replicas=4")
    (folder / "seed-0" / checkpoint.NAME).write_bytes(b"left by a kill after the last DONE")
    assert found("replicas=4").groups == ()
    assert go_on("replicas=4").skipped == [0, 1, 2, 3]


def test_a_run_waits_for_who_computes_it(folder, monkeypatch, capsys):
    lock = Lock(folder / "seed-1" / ".lock", "seed 1")
    assert lock.take()
    monkeypatch.setattr(folders, "PAUSE", 0.01)
    pauses = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        if pauses.count(folders.PAUSE) == 3:
            lock.release()

    monkeypatch.setattr(folders.time, "sleep", pause)
    with pytest.raises(UserError, match=r"seed 1 of .* is being computed by process \d+ on .*wait for it, or stop it"):
        credit.resume(folder)
    assert not pauses
    assert go_on("replicas=4").resumed == [0, 1, 2, 3]
    assert pauses.count(folders.PAUSE) == 3
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith("waiting  seed 1 of ")


def test_resume_of_a_seed_of_all_and_of_nothing(folder, whole, tmp_path):
    assert resume.spans([0, 1, 2, 7, 9, 10]) == [(0, 3), (7, 1), (9, 2)]
    (ended,) = credit.resume(folder / "seed-1")
    assert ended.resumed == [0, 1, 2, 3]
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)
    assert credit.resume(tmp_path) == []
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match=r"empty: no run lies here or below"):
        credit.resume(tmp_path / "empty")


def journal_of(folder: Path, seed: int = 2) -> tuple[Path, list[str]]:
    path = folder / f"seed-{seed}" / "metrics.csv"
    return path, path.read_text().splitlines(keepends=True)


@pytest.mark.parametrize("torn", ["203,0.1,0.2", "2", "203,0.1,0.2,0.3,0.4,0.5,0.6,0.7"])
def test_a_torn_last_line_is_dropped(folder, whole, torn):
    path, _ = journal_of(folder)
    with path.open("a") as file:
        file.write(torn)
    go_on("replicas=4")
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)


@pytest.mark.parametrize("ahead", [1, 2, 4])
def test_rows_ahead_of_the_checkpoint_stay_as_they_are(folder, whole, ahead):
    """A kill may come long after the last checkpoint; some folders are then further than others."""
    path, lines = journal_of(folder)
    later = [line.rpartition(",")[0] + f",{500 + i}.25\n" for i, line in enumerate(journal_of(whole / PLACE)[1])]
    path.write_text("".join([*lines, *later[len(lines) : len(lines) + ahead]]))
    go_on("replicas=4")
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)
    times = [float(row["time/seconds"]) for row in rows(folder, 2, times=True)]
    known = [500 + i + 0.25 for i in range(len(lines), len(lines) + ahead)]
    assert times[len(lines) - 1 : len(lines) - 1 + ahead] == known
    assert times == sorted(times)
    assert len(journal_of(folder)[1]) == len(later)


def test_rows_ahead_that_come_out_otherwise_are_cut_off(folder, whole):
    path, lines = journal_of(folder)
    later = journal_of(whole / PLACE)[1][len(lines) :]
    other = later[1].replace(",", ",7", 1)
    path.write_text("".join([*lines, later[0], other, *later[2:], "a torn li"]))
    go_on("replicas=4")
    assert all(rows(folder, seed) == rows(whole / PLACE, seed) for seed in SEEDS)


@pytest.mark.parametrize("left", [0, 1, None])
def test_a_journal_that_lost_rows_is_refused(folder, left):
    path, lines = journal_of(folder)
    path.unlink() if left is None else path.write_text("".join(lines[:left]))
    expected = (
        rf"seed-2/metrics\.csv: has {left or 0} lines, and the checkpoint beside it was written after {len(lines)}"
    )
    with pytest.raises(UserError, match=expected):
        go_on("replicas=4")


def test_times_rise_though_the_clock_goes_back(tmp_path, monkeypatch, interrupt, whole):
    monkeypatch.chdir(tmp_path)
    now = time.time()

    def backwards() -> float:
        nonlocal now
        now -= 60.0
        return now

    monkeypatch.setattr(time, "time", backwards)
    interrupt(HALF, *WORDS, "replicas=4")
    assert go_on("replicas=4").resumed == [0, 1, 2, 3]
    for seed in SEEDS:
        assert rows(tmp_path / PLACE, seed) == rows(whole / PLACE, seed)
        times = [float(row["time/seconds"]) for row in rows(tmp_path / PLACE, seed, times=True)]
        assert times == sorted(times)
        assert times[0] >= 0


def test_sessions_that_start_in_one_second_have_names_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(time, "strftime", lambda form: "20261122-201500")
    drawn = iter(["3f2a", "3f2a", "3f2a", "77aa"])
    monkeypatch.setattr("credit.runs.session.secrets.token_hex", lambda size: next(drawn))
    sessions = [Session.begin(tmp_path, "job", "advertiser", ["train"], None, [{"seed": seed}]) for seed in (0, 1)]
    assert [session.id for session in sessions] == ["20261122-201500-3f2a", "20261122-201500-77aa"]
    for session in sessions:
        session.finish("FINISHED")


def test_the_folders_say_what_was_computed(folder):
    go_on("replicas=4")
    for seed in SEEDS:
        kept = yaml.safe_load((folder / f"seed-{seed}" / "config.yaml").read_text())
        assert (kept["seed"], kept["replicas"], kept["rerun"]) == (seed, 1, False)


def test_a_journal_without_rows_goes_on_from_its_beginning(tmp_path):
    folders = [tmp_path / "a", tmp_path / "b"]
    first = Journal(folders)
    state = first.state_dict()
    first.log(7, {"x": [1.0, 2.0]})
    first.flush()
    again = Journal(folders, state)
    again.log(7, {"x": [1.0, 2.0]})
    again.log(14, {"x": [3.0, float("nan")]})
    again.flush()
    assert [line.rpartition(",")[0] for line in (folders[0] / "metrics.csv").read_text().splitlines()] == [
        *("step,x", "7,1.0", "14,3.0")
    ]
    assert [line.rpartition(",")[0] for line in (folders[1] / "metrics.csv").read_text().splitlines()] == [
        *("step,x", "7,2.0", "14,")
    ]

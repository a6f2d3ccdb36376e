"""Commands that find a checkpoint which is none, or a disk that takes none."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from credit.runs import checkpoint

WORDS = ("method=disagreement", "replicas=2", "trainer.steps=280", "trainer.log_every=5", "checkpoint_seconds=0")
PLACE = "advertiser/disagreement/trainer.log_every=5,trainer.steps=280"


@pytest.fixture(scope="module")
def whole(tmp_path_factory, interrupt) -> Path:
    """An undisturbed run."""
    import credit

    folder = tmp_path_factory.mktemp("whole")
    credit.run([*WORDS, "tracking=none", f"output={folder}"])
    return folder / PLACE


@pytest.fixture(scope="module")
def half(tmp_path_factory, interrupt) -> Path:
    """A run that was interrupted in the middle."""
    folder = tmp_path_factory.mktemp("half")
    interrupt(147, *WORDS, f"output={folder / 'outputs'}")
    return folder / "outputs"


def results(parent: Path) -> dict[str, Any]:
    """The journals of the runs in a folder, without times."""
    found = {}
    for file in sorted(parent.glob("seed-*/metrics.csv")):
        with file.open() as rows:
            found[file.parent.name] = [
                {key: cell for key, cell in row.items() if key != "time/seconds"} for row in csv.DictReader(rows)
            ]
        assert (file.parent / "DONE").exists()
        assert not list(file.parent.glob("*checkpoint*"))
    assert found
    return found


def snapshot(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def same(before: dict[Path, bytes | None], after: dict[Path, bytes | None]) -> bool:
    """Whether nothing changed; a lock that is looked at says who looked."""
    return all(before.get(path) == after.get(path) for path in before.keys() | after.keys() if path.name != ".lock")


class Evil:
    def __reduce__(self) -> Any:
        return os.mkdir, ("made",)


def hostile(path: Path) -> None:
    torch.save({"format": checkpoint.FORMAT, "version": 1, "seeds": Evil()}, path)
    data = path.read_bytes()
    with path.open("ab") as file, path.open("rb") as whole:
        file.write(checkpoint.MARK + checkpoint._digest(whole, len(data)))


DAMAGED: dict[str, tuple[Callable[[Path], Any], str]] = {
    "cut short": (lambda path: path.write_bytes(path.read_bytes()[:-1000]), "cut short"),
    "hostile": (hostile, "could run code"),
}


@pytest.mark.parametrize("command", ["train", "resume"])
@pytest.mark.parametrize(("damage", "message"), DAMAGED.values(), ids=DAMAGED.keys())
def test_a_checkpoint_that_cannot_be_read_stops_the_command(credit, folder, half, command, damage, message):
    shutil.copytree(half, folder / "outputs")
    file = folder / "outputs" / PLACE / "seed-0" / checkpoint.NAME
    damage(file)
    before = snapshot(folder / "outputs" / PLACE)
    words = ["train", *WORDS, "tracking=none"] if command == "train" else ["resume", f"outputs/{PLACE}/seed-1"]
    ended = credit(*words)
    assert ended.code == 2
    assert message in ended.err
    assert str(file) in ended.err
    assert "Traceback" not in ended.err
    assert not (folder / "made").exists()
    assert same(before, snapshot(folder / "outputs" / PLACE))


def test_the_state_of_other_code_stops_the_command(credit, folder, half):
    shutil.copytree(half, folder / "outputs")
    file = folder / "outputs" / PLACE / "seed-0" / checkpoint.NAME
    content = checkpoint.load(file)
    content["trainer"]["agent"][1]["an attribute of another time"] = 3
    checkpoint.save(file, content)
    before = snapshot(folder / "outputs" / PLACE)
    ended = credit("resume", f"outputs/{PLACE}")
    assert ended.code == 2
    assert f"{file}: the state of other code than this credit's (ValueIteration has the state" in ended.err
    assert same(before, snapshot(folder / "outputs" / PLACE))


@pytest.mark.thorough
def test_rerun_takes_no_notice_of_a_damaged_checkpoint(credit, folder, half, whole):
    shutil.copytree(half, folder / "outputs")
    (folder / "outputs" / PLACE / "seed-0" / checkpoint.NAME).write_bytes(b"rubbish")
    assert credit("train", *WORDS, "tracking=none", "rerun=true").code == 0
    assert results(folder / "outputs" / PLACE) == results(whole)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of one megabyte."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", place], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"only root can mount a small file system: {error}")
    yield place
    subprocess.run(["umount", place], check=True)


def full(disk: Path) -> None:
    with (disk / "ballast").open("wb", buffering=0) as ballast:
        while ballast.write(bytes(4096)) == 4096:
            continue


def read_only(disk: Path) -> None:
    """A file system with open files, like a run's locks, cannot be mounted read-only; this stands for it."""
    _immutable("+i", disk)


def emptied(disk: Path) -> None:
    (disk / "ballast").unlink()


def writable(disk: Path) -> None:
    _immutable("-i", disk)


def _immutable(flag: str, disk: Path) -> None:
    try:
        subprocess.run(["chattr", "-R", flag, disk / "advertiser"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"this file system knows no immutable files: {error}")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("spoil", "mend", "reason"), [(full, emptied, "No space left"), (read_only, writable, "Operation not permitted")]
)
def test_a_disk_that_takes_no_more(credit, disk, monkeypatch, whole, spoil, mend, reason):
    write, count = torch.save, 0

    def spoiled(*arguments: Any) -> None:
        nonlocal count
        count += 1
        if count == 12:
            try:
                spoil(disk)
            except OSError:
                assert spoil is full
        write(*arguments)

    monkeypatch.setattr(torch, "save", spoiled)
    words = ("train", *WORDS, "tracking=none", f"output={disk}")
    ended = credit(*words)
    monkeypatch.undo()
    assert ended.code == 1
    assert reason in ended.err
    assert "Traceback" not in ended.err
    assert checkpoint.load(disk / PLACE / "seed-0" / checkpoint.NAME)["trainer"]["rounds"] == 11
    mend(disk)
    assert not list(disk.rglob(".checkpoint*")) or spoil is read_only
    again = credit(*words)
    assert again.code == 0
    assert results(disk / PLACE) == results(whole)

"""A checkpoint is there as a whole or not at all, and reading one runs no code."""

from __future__ import annotations

import os
import pickle
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.runs import checkpoint

CONTENT = {
    "seeds": [3, 4],
    "trainer": {"x": torch.arange(600.0).view(2, 300), "none": torch.zeros(0, 2), "stream": {"state": 2**120}},
    "last": [{"a": float("nan"), "b": 0.1}, {}],
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / checkpoint.NAME


def sealed(path: Path) -> None:
    """Behind a file, what a checkpoint of credit has behind it."""
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        file.write(checkpoint.MARK + checkpoint._digest(file, size))


def test_what_was_saved_is_loaded(path):
    checkpoint.save(path, CONTENT)
    found = checkpoint.load(path)
    assert found["seeds"] == [3, 4]
    assert torch.equal(found["trainer"]["x"], CONTENT["trainer"]["x"])
    assert found["trainer"]["none"].shape == (0, 2)
    assert found["trainer"]["stream"] == {"state": 2**120}
    assert repr(found["last"]) == repr(CONTENT["last"])
    assert [file.name for file in path.parent.iterdir()] == [checkpoint.NAME]


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, made: Path) -> None:
        self.made = made

    def __reduce__(self) -> Any:
        return open, (str(self.made), "w")


def test_the_hostile_example_would_run(tmp_path):
    pickle.loads(pickle.dumps(Evil(tmp_path / "made"))).close()
    assert (tmp_path / "made").exists()


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("seal", [False, True])
@pytest.mark.parametrize("how", ["torch", "old torch", "pickle"])
def test_a_hostile_file_is_refused_and_runs_nothing(path, how, seal):
    made = path.parent / "made"
    content = {"format": checkpoint.FORMAT, "version": checkpoint.VERSION, "trainer": Evil(made)}
    if how == "pickle":
        path.write_bytes(pickle.dumps(content))
    else:
        torch.save(content, path, _use_new_zipfile_serialization=how == "torch")
    if seal:
        sealed(path)
    with pytest.raises(UserError, match=re.escape(str(path))) as refused:
        checkpoint.load(path)
    assert not made.exists()
    assert "weights_only" not in str(refused.value)
    assert "Nothing was changed" in str(refused.value)
    if seal and how == "torch":
        assert "could run code when it is read (io.open)" in str(refused.value)


def text(path: Path) -> None:
    path.write_text("seed: 3\n" * 100)


def other_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("hello.txt", "hello")


def arrays(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, x=np.ones(3))


FOREIGN: dict[str, Callable[[Path], Any]] = {
    "empty": lambda path: path.write_bytes(b""),
    "text": text,
    "zip": other_zip,
    "arrays": arrays,
    "weights": lambda path: torch.save(torch.nn.Linear(2, 2).state_dict(), path),
    "whole module": lambda path: torch.save(torch.nn.Linear(2, 2), path),
    "a tensor": lambda path: torch.save(torch.ones(2), path),
}


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("seal", [False, True])
@pytest.mark.parametrize("make", FOREIGN.values(), ids=FOREIGN.keys())
def test_a_foreign_file_is_refused(path, make, seal):
    make(path)
    if seal:
        sealed(path)
    before = path.read_bytes()
    with pytest.raises(UserError, match=rf"{re.escape(str(path))}: .*Nothing was changed.*rerun=true"):
        checkpoint.load(path)
    assert path.read_bytes() == before


def test_a_missing_file_and_another_version_are_refused(path, monkeypatch):
    with pytest.raises(UserError, match=rf"{re.escape(str(path))}: there is no checkpoint"):
        checkpoint.load(path)
    monkeypatch.setattr(checkpoint, "VERSION", 7)
    checkpoint.save(path, CONTENT)
    monkeypatch.undo()
    with pytest.raises(UserError, match=r"a checkpoint of format 7, and this credit reads format 1"):
        checkpoint.load(path)


def test_a_file_that_was_cut_short_is_refused(path):
    checkpoint.save(path, CONTENT)
    whole = path.read_bytes()
    lengths = {*range(0, len(whole), 97), 1, len(whole) - 1, len(whole) - checkpoint.TAIL}
    for length in lengths:
        path.write_bytes(whole[:length])
        with pytest.raises(UserError, match=r"cut short"):
            checkpoint.load(path)
    for longer in (whole + b"\0", whole + whole):
        path.write_bytes(longer)
        with pytest.raises(UserError, match=r"cut short|damaged"):
            checkpoint.load(path)


def test_one_flipped_bit_anywhere_is_noticed(path):
    """Not in the tensors alone: a bit in the zip's table of contents made PyTorch return what lay in memory."""
    checkpoint.save(path, CONTENT)
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        with pytest.raises(UserError, match=r"damaged|no checkpoint of credit"):
            checkpoint.load(path)


@pytest.mark.parametrize("at", ["save", "fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_error_while_writing_leaves_the_old_file_alone(path, monkeypatch, at, error):
    checkpoint.save(path, CONTENT)
    before = path.read_bytes()

    def fail(*arguments: Any) -> None:
        raise error

    monkeypatch.setattr(*{"save": (torch, "save"), "fsync": (os, "fsync"), "replace": (Path, "replace")}[at], fail)
    with pytest.raises(type(error)):
        checkpoint.save(path, {"seeds": []})
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == [checkpoint.NAME]


def test_what_a_kill_left_is_in_nobodys_way(path):
    half = path.with_name(f".{path.name}")
    half.write_bytes(b"half")
    checkpoint.save(path, CONTENT)
    assert not half.exists()
    half.write_bytes(b"half")
    checkpoint.remove(path)
    assert list(path.parent.iterdir()) == []
    checkpoint.remove(path)


@pytest.mark.parametrize(
    ("value", "kind"),
    [(np.ones(2), "ndarray"), (np.float64(1), "float64"), ({1, 2}, "set"), (torch.device("cpu"), "device")],
)
def test_what_could_not_be_loaded_is_not_written(path, value, kind):
    with pytest.raises(TypeError, match=rf"trainer\.env\.0 of a state is a {kind}, .*credit\.core\.state\.pack"):
        checkpoint.save(path, {"trainer": {"env": [value]}})
    assert list(path.parent.iterdir()) == []

"""The state of a job between two rounds in a file: written whole or not at all, read without running any code."""

from __future__ import annotations

import hashlib
import os
import pickle
import re
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import torch

from credit.core.errors import UserError
from credit.core.state import PLAIN

NAME = "checkpoint.pt"
FORMAT, VERSION = "credit checkpoint", 1
MARK = b"credit checkpoint, SHA-256:"  # behind PyTorch's file, with the digest of all that lies before it
TAIL = len(MARK) + hashlib.sha256().digest_size
CHUNK = 2**20


def save(path: Path, content: Mapping[str, Any], durable: bool = True) -> None:
    """Write tensors and plain data: a reader, or who comes after a power cut, sees the old file or the new one.

    Args:
        path: the file. content: what goes into it.
        durable: whether it is on the disk at the end; without, somebody sees to that later.

    Raises:
        OSError: the disk is full or cannot be written; what was there before is still there.
        TypeError: something else is in it, which `load` would refuse.
    """
    only_data(dict(content), "")
    temporary = path.with_name(f".{path.name}")  # one name: who was killed leaves it to the next
    try:
        with temporary.open("w+b") as file:
            torch.save({"format": FORMAT, "version": VERSION, **content}, file)
            size = file.seek(0, os.SEEK_END)
            digest = _digest(file, size)
            file.seek(size)
            file.write(MARK + digest)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        temporary.replace(path)
        if durable:
            _sync_folder(path.parent)
    except RuntimeError as error:  # how PyTorch's writer reports that the disk is full
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise OSError(f"{path}: the checkpoint could not be written ({_first_line(error)})") from error
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def remove(path: Path) -> None:
    """Remove a checkpoint that nobody needs any more, and what a kill left of another."""
    path.unlink(missing_ok=True)
    path.with_name(f".{path.name}").unlink(missing_ok=True)


def load(path: Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """Read a checkpoint: tensors and plain data, nothing else.

    Raises:
        UserError: the file is missing, damaged, of another kind, or wants to run code.
    """
    what_to_do = "Nothing was changed. Restore the file from a copy, or compute the run anew with rerun=true"
    if not path.exists():
        raise UserError(f"{path}: there is no checkpoint")
    _verify(path, what_to_do)  # PyTorch reads past bits that have flipped
    try:
        content = torch.load(path, map_location=device, weights_only=True)
    except pickle.UnpicklingError as error:
        named = re.search(r"GLOBAL ([\w.]+)", str(error))  # the rest advises to read it all the same
        raise UserError(
            f"{path}: refused, since it holds more than tensors and plain data and could run code when it is read"
            f"{f' ({named[1]})' if named else ''}. {what_to_do}"
        ) from None
    except (RuntimeError, ValueError, LookupError, TypeError, AttributeError, EOFError) as error:
        raise UserError(f"{path}: no file of PyTorch ({_first_line(error)}). {what_to_do}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UserError(f"{path}: a file of PyTorch, but no checkpoint of credit. {what_to_do}")
    if content["version"] != VERSION:
        raise UserError(
            f"{path}: a checkpoint of format {content['version']}, and this credit reads format {VERSION}; go on with "
            "the credit that wrote it, or compute the run anew with rerun=true"
        )
    return content


def only_data(value: Any, where: str) -> None:
    """Refuse a state that no checkpoint could hold.

    Raises:
        TypeError: there is more in it than tensors and plain data, as `pack` makes of most things.
    """
    if value is None or type(value) in PLAIN or isinstance(value, torch.Tensor):
        return
    if type(value) not in (list, tuple, dict, OrderedDict):
        raise TypeError(
            f"{where.strip('.')} of a state is a {type(value).__name__}, and a checkpoint holds tensors and plain "
            "data: use credit.core.state.pack in state_dict, and unpack in load_state_dict"
        )
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        only_data(inner, f"{where}.{key}")


def _verify(path: Path, what_to_do: str) -> None:
    """Raises UserError unless the file is what `save` wrote, to the bit."""
    with path.open("rb") as file:
        whole = file.seek(0, os.SEEK_END)
        file.seek(max(whole - TAIL, 0))
        tail = file.read()
        if not tail.startswith(MARK):
            raise UserError(f"{path}: no checkpoint of credit, or cut short ({whole} bytes). {what_to_do}")
        if tail != MARK + _digest(file, whole - TAIL):
            raise UserError(f"{path}: the checkpoint is damaged (its checksum is wrong). {what_to_do}")


def _digest(file: BinaryIO, size: int) -> bytes:
    """SHA-256 of the first bytes of a file."""
    digest = hashlib.sha256()
    file.seek(0)
    while chunk := file.read(min(CHUNK, size - file.tell())):
        digest.update(chunk)
    return digest.digest()


def _sync_folder(folder: Path) -> None:
    """Make a rename last through a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]

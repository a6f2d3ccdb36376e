"""Locks on folders: who computes what. They end with their process, however it ends."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Any

MANY = 2**16
MOMENT = 0.05  # seconds


class Lock:
    """An exclusive lock on a file, which says who holds it; also between machines where the file system has locks.

    Args:
        path: of the file; its folder exists. It is removed with the lock, and stays where its process was killed.
        what: what is locked, for messages.
    """

    def __init__(self, path: Path, what: str = "") -> None:
        self.path, self.what = path, what
        self._handle: int | None = None

    def take(self) -> bool:
        """Try to take the lock, without waiting; whether it is held now."""
        if self._handle is None and not self._try():
            time.sleep(MOMENT)  # somebody may only have looked whether it is held
            self._try()
        return self._handle is not None

    def _try(self) -> bool:
        _room_for_handles()
        while True:
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                current = self._is(handle)
            except BlockingIOError:
                os.close(handle)
                return False
            except BaseException:
                os.close(handle)
                raise
            if current:
                break
            os.close(handle)  # who held it has just removed it
        holder = {"host": socket.gethostname(), "pid": os.getpid(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        with contextlib.suppress(OSError):  # a full disk: the lock holds without a name
            os.ftruncate(handle, 0)
            os.pwrite(handle, json.dumps(holder).encode(), 0)
        self._handle = handle
        return True

    def release(self) -> None:
        """Let others take it."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)
            os.close(self._handle)
            self._handle = None

    def _is(self, handle: int) -> bool:
        """Whether the file is still the one that lies there."""
        try:
            return os.path.samestat(os.fstat(handle), self.path.stat())
        except FileNotFoundError:
            return False

    def held_elsewhere(self) -> bool:
        """Whether somebody else holds it now."""
        if self._handle is not None:
            return False
        try:
            handle = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
        except FileNotFoundError:
            return False
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)  # for a moment; who takes the lock just then tries again
        except BlockingIOError:
            return True
        finally:
            os.close(handle)
        return False

    def holder(self) -> str:
        """Who holds it: `process 123 on host, since 2026-11-22 20:15:00`."""
        try:
            facts: dict[str, Any] = json.loads(self.path.read_text(encoding="utf-8"))
            return f"process {facts['pid']} on {facts['host']}, since {facts['since']}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"

    def __enter__(self) -> Lock:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self.release()


def _room_for_handles() -> None:
    """As many open files as the system allows: a job of 1,000 seeds holds 1,000 locks."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MANY if hard == resource.RLIM_INFINITY else min(hard, MANY)
    if soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))

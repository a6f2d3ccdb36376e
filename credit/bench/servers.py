"""Tracking servers that live as long as a block: `mlflow server`, PostgreSQL; on 127.0.0.1 and free ports."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

START_SECONDS = 300.0
NOBODY = "nobody"  # PostgreSQL refuses to run as root


def free_port() -> int:
    """A port of 127.0.0.1 that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Server:
    """An `mlflow server` that can be stopped and started again at the same address.

    Args:
        store: address of its database. folder: for its artifacts and its log.
    """

    def __init__(self, store: str, folder: Path) -> None:
        self.store, self.folder, self.port = store, folder, free_port()
        self.uri = f"http://127.0.0.1:{self.port}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it answers.

        Raises:
            RuntimeError: it does not.
        """
        command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(self.port)]
        command += ["--workers", "1", "--backend-store-uri", self.store]
        command += ["--artifacts-destination", str(self.folder / "artifacts")]
        quiet = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_DISABLE_TELEMETRY": "true"}
        with (self.folder / "server.log").open("ab") as log:
            self._process = subprocess.Popen(
                command, env=os.environ | quiet, stdout=log, stderr=log, start_new_session=True
            )
        end = time.monotonic() + START_SECONDS
        while time.monotonic() < end and self._process.poll() is None:
            with suppress(OSError), urllib.request.urlopen(f"{self.uri}/health", timeout=10):
                return
            time.sleep(0.2)
        self.stop()
        said = (self.folder / "server.log").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise RuntimeError(f"mlflow server did not start on {self.store}: {said[-1] if said else 'it said nothing'}")

    def stop(self) -> None:
        """Stop it with its workers."""
        if self._process is not None:
            os.killpg(self._process.pid, 15)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(10)
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, 9)
            self._process.wait()
            self._process = None

    def __enter__(self) -> Server:
        self.start()
        return self

    def __exit__(self, *of_error: object) -> None:
        self.stop()


def postgresql_programs() -> Path | None:
    """The folder of PostgreSQL's programs, or None where it is not installed; Debian leaves them out of the path."""
    debian = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    found = debian[-1] if debian else shutil.which("initdb")
    return Path(found).parent if found else None


@contextmanager
def postgresql(folder: Path) -> Iterator[str]:
    """A PostgreSQL of one's own with an empty database; its SQLAlchemy address.

    Args:
        folder: an empty one, outside of folders that only root may enter.

    Raises:
        RuntimeError: PostgreSQL is not installed.
    """
    programs = postgresql_programs()
    if programs is None:
        raise RuntimeError("PostgreSQL is not installed; on Debian: apt-get install postgresql")
    root = os.getuid() == 0
    if root:
        shutil.chown(folder, NOBODY)
    data, port = folder / "data", free_port()

    def program(name: str, *words: str) -> Sequence[str]:
        """Run one of its programs to its end, as somebody who is not root."""
        user = pwd.getpwnam(NOBODY).pw_uid if root else None
        command = [str(programs / name), *words]
        subprocess.run(command, check=True, user=user, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return command

    program("initdb", "-D", str(data), "-U", "credit", "--auth=trust", "--encoding=UTF8", "--no-sync")
    options = f"-h 127.0.0.1 -p {port} -k {folder}"
    program("pg_ctl", "-D", str(data), "-w", "-l", str(folder / "log"), "-o", options, "start")
    try:
        yield f"postgresql+psycopg://credit@127.0.0.1:{port}/postgres"
    finally:
        program("pg_ctl", "-D", str(data), "-m", "immediate", "stop")

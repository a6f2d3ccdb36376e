"""`credit dashboard`: MLflow's UI on the project's store, opened on the newest curves."""

from __future__ import annotations

import os
import socket
import sqlite3
import sys
from pathlib import Path

from credit.cli.main import guarded
from credit.cli.words import Reader, read_words, whole
from credit.core.errors import UserError
from credit.tracking import server
from credit.tracking.mirrored import missing
from credit.tracking.store import VARIABLE, follow, quiet_environment, resolve_uri, sqlite_file, uri_problem

HOST = "127.0.0.1"
PORT = 5000

HELP = f"""\
Open MLflow's UI on the project's store, on {HOST}; it shows the newest sweep.

Usage: credit dashboard [KEY=VALUE ...]

  output=DIR   the output folder whose store is shown    (outputs)
  port=N       the port                                  ({PORT})
  uri=URI      another tracking store                    (MLFLOW_TRACKING_URI, or mlflow.db in the output folder)
"""
READERS: dict[str, Reader] = {
    "output": ("output", Path, "a folder"),
    "port": ("port", whole(1), "a whole number, 1 or more"),
    "uri": ("uri", str, "a tracking URI"),
}


def main(argv: list[str]) -> int:
    """Check the store and the port, then serve until Ctrl-C."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    return dashboard(**read_words(argv, READERS, "dashboard"))


def dashboard(output: Path = Path("outputs"), port: int = PORT, uri: str | None = None) -> int:
    """Serve the UI until Ctrl-C.

    Args:
        output: the output folder. port: on 127.0.0.1. uri: tracking URI; None is that of the
            environment, or the folder's own store.

    Returns:
        The exit code, 0.

    Raises:
        UserError: MLflow is not installed, there is no store, it cannot be read, or the port is taken.
    """
    if problem := missing("mlflow"):
        raise UserError(problem)
    uri = uri if uri is not None else os.environ.get(VARIABLE) or None
    if problem := uri_problem(uri):
        raise UserError(problem.replace("tracking.uri=", "uri=", 1))
    uri = resolve_uri(uri, output)
    os.environ.update(quiet_environment() | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"})
    if uri.startswith("http"):
        print(f"open {uri.rstrip('/')}/{server.newest(uri)}")
        return 0
    store = sqlite_file(uri)
    if store is not None and not store.exists():
        raise UserError(
            f"there is no tracking store {store} yet; train first, for example:\n"
            "credit train -m experiment=advertiser method=delayed,reference,disagreement replicas=5"
        )
    try:
        if uri == resolve_uri(None, output):
            follow(output)
    except sqlite3.DatabaseError as error:
        raise UserError(
            f"the tracking store {store} cannot be read ({error}); move it away, and `credit sync {output}` makes it "
            "anew from the runs"
        ) from None
    server.newest(uri)
    _require_free(port)
    print(f"dashboard: http://{HOST}:{port}/   (Ctrl-C ends it)", flush=True)
    server.serve(uri, HOST, port)
    return 0


def _require_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except (OSError, OverflowError) as error:
            raise UserError(f"port={port} on {HOST} cannot be used ({error}); try port={PORT + 1}") from None


if __name__ == "__main__":
    sys.exit(guarded("dashboard", sys.argv[1:]))

"""Ctrl-C before anything is made."""

from __future__ import annotations

import signal
import subprocess
import sys

CODE = """
import os, signal
from credit.cli.main import nothing_begun
with nothing_begun("train"):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        signal.pause()
    except BaseException:  # as a library does that is just being imported
        print("swallowed")
print("went on")
"""


def test_it_ends_a_command_that_imports_whatever_a_library_swallows() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "credit train: interrupted\n"


def test_the_usual_handler_is_back_afterwards() -> None:
    from credit.cli.main import nothing_begun

    before = signal.getsignal(signal.SIGINT)
    with nothing_begun("train"):
        pass
    assert signal.getsignal(signal.SIGINT) is before

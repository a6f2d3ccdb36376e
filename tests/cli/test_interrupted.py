"""Ctrl-C before anything is made."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from credit.config import launchers

HEARS = """
import os, signal, threading, time
from credit.config import launchers
heard = []
signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
threading.Thread(target=time.sleep, args=(20,), daemon=True).start()
with launchers._deaf("joblib"):
    os.kill(os.getpid(), signal.SIGINT)
    end = time.monotonic() + 10
    while not heard and time.monotonic() < end:
        time.sleep(0.01)
    print("heard" if heard else "deaf")
"""
CODE = """
import os, signal
from credit.cli.main import nothing_begun
signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored where a shell started all this with &
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


@pytest.mark.parametrize(
    ("launcher", "deaf"),
    [
        ("hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher", True),
        ("hydra._internal.core_plugins.basic_launcher.BasicLauncher", False),
    ],
)
def test_workers_are_born_deaf_to_it_and_the_command_is_not(launcher: str, deaf: bool) -> None:
    """What is imported when it comes would end in a traceback for each worker."""
    heard = threading.Event()
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.set())
    try:
        with launchers._deaf(launcher):
            worker = subprocess.Popen([sys.executable, "-c", "print(input())"], stdin=-1, stdout=-1, text=True)
            os.kill(worker.pid, signal.SIGINT)
            said, _ = worker.communicate("lives")
        assert (worker.returncode == 0, said == "lives\n") == (deaf, deaf)
        os.kill(os.getpid(), signal.SIGINT)
        assert heard.wait(10)
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_command_hears_it_while_its_workers_are_deaf() -> None:
    """Through a thread beside, as the follower's is."""
    done = subprocess.run([sys.executable, "-c", HEARS], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "heard\n"), done.stderr

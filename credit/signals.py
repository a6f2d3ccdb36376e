"""Signals that end a run where its state is whole."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STOPS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether a signal has asked for the end."""

    def __init__(self) -> None:
        self.asked = False

    def __bool__(self) -> bool:
        return self.asked


@contextmanager
def noted() -> Iterator[Stop]:
    """Note the first SIGINT or SIGTERM; the second one is KeyboardInterrupt at once.

    Outside the main thread, where Python handles no signals, nothing is noted.
    """
    stop = Stop()

    def note(number: int, frame: Any) -> None:
        if stop:
            raise KeyboardInterrupt
        stop.asked = True
        os.write(2, b"stopping after this round, with a checkpoint; once more stops at once\n")

    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, note) for number in STOPS}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

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

    What is ignored stays ignored: a worker that shares a terminal with its command leaves Ctrl-C to it. Outside the
    main thread, where Python handles no signals, nothing is noted.
    """
    stop = Stop()

    def note(number: int, frame: Any) -> None:
        if stop:
            raise KeyboardInterrupt
        stop.asked = True
        if number == signal.SIGINT:
            os.write(2, b"\nstopping after this round, with a checkpoint; once more stops at once\n")

    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    heard = [number for number in STOPS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

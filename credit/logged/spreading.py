"""Passes over rows as jobs: what is done to each section of a panel, here or on other machines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from credit.logged.panel import Panel

Found = TypeVar("Found")
Runner = Callable[[Callable[[Panel], Any], Sequence[Panel]], list[Any]]  # what a function finds in each section
_RUNNER: ContextVar[Runner | None] = ContextVar("runner", default=None)


@contextmanager
def spread_over(runner: Runner) -> Iterator[None]:
    """Within this, sections of panels are given to `runner`."""
    token = _RUNNER.set(runner)
    try:
        yield
    finally:
        _RUNNER.reset(token)


def mapped(function: Callable[[Panel], Found], panel: Panel) -> list[Found]:
    """What a function, which can be pickled, finds in each section of a panel, in order; in all of it by default."""
    runner = _RUNNER.get()
    if runner is None:
        return [function(panel)]
    return runner(function, panel.sections())

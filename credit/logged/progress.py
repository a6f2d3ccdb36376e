"""How far a long recovery is: passes over rows and draws tell it, and whoever shows it asks here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from credit.logged.panel import Panel, Part

Teller = Callable[[str, int, int], None]  # what is done, how much of it, of how much
_TELLER: ContextVar[Teller | None] = ContextVar("teller", default=None)


@contextmanager
def told_to(teller: Teller) -> Iterator[None]:
    """Within this, `teller` is told how far everything is."""
    token = _TELLER.set(teller)
    try:
        yield
    finally:
        _TELLER.reset(token)


def tell(what: str, done: int, whole: int) -> None:
    """Say how much of something is done."""
    if (teller := _TELLER.get()) is not None:
        teller(what, done, whole)


def watched(panel: Panel, what: str) -> Iterator[Part]:
    """The parts of a panel; how many rows came by is told."""
    done = 0
    for part in panel.parts():
        yield part
        done += len(part)
        tell(what, done, panel.rows)

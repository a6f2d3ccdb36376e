"""What becomes of a session's local journal while it grows: the seam of trackers, and none of them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path

from credit.core.component import Component


class Tracking(Component):
    """Follows the journal of one session from outside."""

    @abstractmethod
    def check(self, output: Path) -> list[str]:
        """Problems that can be found before anything is made; nothing is opened or created."""

    @abstractmethod
    def start(self, session_dir: Path, output: Path) -> None:
        """Begin to follow a session whose `session.json` exists; returns at once and never fails."""

    @abstractmethod
    def look(self, output: Path) -> str | None:
        """The command that shows what is tracked in an output folder; None where there is nothing to see."""

    @abstractmethod
    def news(self) -> str | None:
        """A line when something has gone wrong for good, once; None at all other times. Cheap: may be called often."""

    @abstractmethod
    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Wait, after `session.json` says that the session ended, until everything is uploaded.

        Args:
            timeout: seconds to wait at most; None waits as long as there is hope.
            on_progress: called now and then with (rows uploaded, rows in all).

        Returns:
            One line about what could not be uploaded, or None.
        """


class NoTracking(Tracking):
    """The local journal only."""

    def check(self, output: Path) -> list[str]:
        """Nothing can be wrong."""
        return []

    def start(self, session_dir: Path, output: Path) -> None:
        """Nothing to begin."""

    def look(self, output: Path) -> str | None:
        """Nothing to see."""
        return None

    def news(self) -> str | None:
        """Nothing can go wrong."""
        return None

    def finish(self, timeout: float | None = None, on_progress: Callable[[int, int], None] | None = None) -> str | None:
        """Nothing to wait for."""
        return None

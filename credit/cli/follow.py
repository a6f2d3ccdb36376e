"""What the terminal shows of the jobs of a command while they run: bars, and a line when one ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from credit.cli.board import Board
from credit.cli.outcome import Job, differing, duration, line
from credit.runs.catalogue import progress_of

EVERY = 0.25  # seconds between two looks at the board
SAID_EVERY = 30.0  # seconds between two lines where there are no bars
KNOWN = 0.05  # of all that is to be done: from there on its pace is known
RUNNING_SHOWN = 8


class Follower:
    """A thread that follows the board of a command, whatever its launcher.

    Args:
        board: the board. jobs: number → configuration and overrides of every job; more may come later.
        console: where lines and bars go. news: what else the user should be told now, if anything.
        total: how many jobs there will be; None is as many as there are. quiet: whether nothing is said of those that
            end well.
    """

    def __init__(
        self,
        board: Board,
        jobs: Mapping[int, Job],
        console: Console,
        news: Callable[[], str | None] = lambda: None,
        total: int | None = None,
        quiet: bool = False,
    ) -> None:
        self.facts: dict[int, dict[str, Any]] = {}
        self._board, self._jobs, self._console, self._news = board, jobs, console, news
        self._total, self._quiet = len(jobs) if total is None else total, quiet
        self._said: set[int] = set()
        self._bars: dict[int, TaskID] = {}
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"))
        times = (TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
        self._progress = Progress(
            *columns, *times, console=console, transient=True, disable=not console.is_terminal, redirect_stdout=False
        )
        self._begun = self._last = time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follower", daemon=True)

    def __enter__(self) -> Follower:
        self._progress.start()
        if self._total > 1:
            self._all = self._progress.add_task("jobs", total=self._total, left="")
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self._over.set()
        self._thread.join()
        self._look()
        self._progress.stop()

    def running(self) -> list[dict[str, Any]]:
        """The jobs that have begun and have not ended, as far as is known."""
        return [facts for facts in self._board.read().values() if facts["state"] == "running"]

    def ended(self, number: int) -> bool:
        """Whether a job has ended, well or not."""
        return self._board.read().get(number, {}).get("state") == "ended"

    def _follow(self) -> None:
        while not self._over.wait(EVERY):
            self._look()

    def _look(self) -> None:
        self.facts = self._board.read()
        if news := self._news():
            self._console.print(f"[yellow]note[/yellow]    {escape(news)}", soft_wrap=True)
        for number, facts in self.facts.items():
            if facts["state"] == "ended":
                self._remove(number)
                if number not in self._said:
                    self._said.add(number)
                    if not (self._quiet and facts["status"] == "FINISHED"):
                        self._last = time.monotonic()
                        said = line(facts, self._jobs[number][0], differing(self._jobs)[number], self._log(number))
                        self._console.print(said, soft_wrap=True)
            elif number in self._bars or len(self._bars) < RUNNING_SHOWN:
                self._show(number, facts)
        share = self._share()
        if self._total > 1:
            left = _left(self._rest(share))
            self._progress.update(
                self._all, completed=share * self._total, description=f"{self._total} jobs", left=left
            )
        if not self._console.is_terminal and time.monotonic() - self._last >= SAID_EVERY:
            self._last = time.monotonic()
            self._console.print(escape(self._meanwhile(share)), soft_wrap=True)

    def _share(self) -> float:
        """How much of all jobs is done; those that run count by their steps."""
        running = (facts for facts in self.facts.values() if facts["state"] == "running" and facts["total"])
        return (len(self._said) + sum(facts["steps"] / facts["total"] for facts in running)) / self._total

    def _rest(self, share: float) -> float | None:
        """Seconds until all is done, at the pace so far; at the very beginning nobody knows."""
        return (time.monotonic() - self._begun) * (1 / share - 1) if share >= KNOWN else None

    def _meanwhile(self, share: float) -> str:
        """What a log is told every now and then."""
        first = next((facts for facts in self.facts.values() if facts["state"] == "running"), None)
        if self._total == 1:
            left = progress_of(first).left if first else None
            name = first["title"] if first else "starting"
        else:
            left = self._rest(share)
            name = f"{len(self._said)} of {self._total} jobs ended"
        return ", ".join(filter(None, [f"running {name or 'starting'}: {share:.0%}", _left(left)]))

    def _show(self, number: int, facts: dict[str, Any]) -> None:
        """The bar of a job that runs; its title says what it has come to."""
        title = facts["title"] or self._jobs[number][0]["title"]
        total, seconds = facts["total"] or None, progress_of(facts).left
        if number not in self._bars:
            self._bars[number] = self._progress.add_task(escape(title), total=total, left="")
        left = _left(seconds)
        bar = self._bars[number]
        self._progress.update(bar, completed=facts["steps"], total=total, description=escape(title), left=left)

    def _remove(self, number: int) -> None:
        if number in self._bars:
            self._progress.remove_task(self._bars.pop(number))

    def _log(self, number: int) -> Path:
        return self._board.session / f"job-{number}.log"


def _left(seconds: float | None) -> str:
    return "" if seconds is None else f"{duration(seconds)} left"

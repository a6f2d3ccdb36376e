"""What the terminal shows of the jobs of a command: a line when one ends, bars meanwhile, a table at the end."""

from __future__ import annotations

import contextlib
import math
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from credit.cli.board import Board

EVERY = 0.25  # seconds between two looks at the board
COLOURS = {"done": "green", "done before": "green", "failed": "red", "killed": "yellow", "not run": "yellow"}
RUNNING_SHOWN = 8

Job = tuple[dict[str, Any], list[str]]


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
        times = (TimeElapsedColumn(), TimeRemainingColumn())
        self._progress = Progress(
            *columns, *times, console=console, transient=True, disable=not console.is_terminal, redirect_stdout=False
        )
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follower", daemon=True)

    def __enter__(self) -> Follower:
        self._progress.start()
        if self._total > 1:
            self._all = self._progress.add_task("jobs", total=self._total)
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
                        self._console.print(line(facts, *self._jobs[number], self._log(number)), soft_wrap=True)
            elif number in self._bars or len(self._bars) < RUNNING_SHOWN:
                self._show(number, facts)
        if self._total > 1:
            self._progress.update(self._all, completed=len(self._said), description=f"{self._total} jobs")

    def _show(self, number: int, facts: dict[str, Any]) -> None:
        """The bar of a job that runs; its title says what it has come to."""
        title = facts["title"] or self._jobs[number][0]["title"]
        total = facts["total"] or None
        if number not in self._bars:
            self._bars[number] = self._progress.add_task(escape(title), total=total)
        self._progress.update(self._bars[number], completed=facts["steps"], total=total, description=escape(title))

    def _remove(self, number: int) -> None:
        if number in self._bars:
            self._progress.remove_task(self._bars.pop(number))

    def _log(self, number: int) -> Path:
        return self._board.session / f"job-{number}.log"


def line(facts: dict[str, Any], config: dict[str, Any], overrides: Sequence[str], log: Path) -> str:
    """One line about a job that has just ended."""
    name = escape(f"{facts['title']} on {config['experiment']}")
    if facts["status"] == "KILLED":
        return f"[yellow]killed[/yellow]  {name}: interrupted; the same command goes on with it"
    if facts["status"] != "FINISHED":
        where = f" (traceback: {shown(log)})" if log.exists() else ""
        return f"[red]failed[/red]  {name}: {escape(facts['error'] + where)}"
    if not facts["computed"]:
        return f"[green]done[/green]    {name}: all {facts['skipped']} seeds were done before"
    done = f", {facts['skipped']} already done" if facts["skipped"] else ""
    resumed = f", {facts['resumed']} of them resumed" if facts["resumed"] else ""
    numbers = {key: math.nan if value is None else value for key, value in facts["values"].items()}  # JSON has no NaN
    values = ", ".join(f"{key} {value:.4g}" for key, value in numbers.items())
    took = f"{facts['computed']} seeds in {facts['seconds']:.1f} s{resumed}{done}"
    return f"[green]done[/green]    {name}: {took}. {escape(values)}"


def status(facts: dict[str, Any] | None) -> str:
    """How a job stands, in a word or two; None is one that never began."""
    if facts is None:
        return "not run"
    if facts["state"] == "running" or facts["status"] == "KILLED":
        return "killed"
    if facts["status"] == "FAILED":
        return "failed"
    return "done" if facts["computed"] else "done before"


def table(facts: dict[int, dict[str, Any]], jobs: Mapping[int, Job]) -> Table:
    """All jobs with their status, and the words by which they differ."""
    shared = set.intersection(*(set(overrides) for _, overrides in jobs.values()))
    shown_table = Table("job", "status", "method", "overrides", "seeds", "s", title_justify="left", box=None)
    for number, (config, overrides) in jobs.items():
        job = facts.get(number)
        word = status(job)
        seeds = f"{config['seed']}–{config['seed'] + config['replicas'] - 1}"
        differing = " ".join(text for text in overrides if text not in shared)
        seconds = f"{job['seconds']:.1f}" if job and "seconds" in job else ""
        status_cell = f"[{COLOURS[word]}]{word}[/]"
        shown_table.add_row(str(number), status_cell, escape(config["title"]), escape(differing), seeds, seconds)
    return shown_table


def counts(facts: dict[int, dict[str, Any]], jobs: Mapping[int, Job]) -> list[str]:
    """How many jobs ended how, and how many runs (seeds) were done before, resumed and run."""
    words = Counter(status(facts.get(number)) for number in jobs)
    ended = [job for job in facts.values() if job.get("status") == "FINISHED"]
    before, resumed = (sum(job[key] for job in ended) for key in ("skipped", "resumed"))
    run = sum(job["computed"] for job in ended) - resumed
    return [
        "jobs     " + ", ".join(f"{words[word]} {word}" for word in COLOURS if words[word]),
        f"seeds    {before} done before, {resumed} resumed, {run} run",
    ]


def shown(path: Path) -> Path:
    """A path relative to the working folder where it lies inside it."""
    with contextlib.suppress(ValueError):
        return path.relative_to(Path.cwd())
    return path

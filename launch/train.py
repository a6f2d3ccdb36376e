"""`credit train`: one job, or a sweep with -m."""

from __future__ import annotations

import contextlib
import shlex
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from credit import registry
from credit.errors import UserError
from launch.cli import guarded
from launch.common import Words, help_text

HEADLINES = ("regret/cumulative", "policy/error", "reward/mse", "eval/final", "eval/auc", "return/label")


@dataclass
class Outcome:
    """How a command's jobs ended."""

    results: list[Any] = field(default_factory=list)

    @property
    def status(self) -> str:
        """FAILED if any job failed."""
        return "FAILED" if any(result.status != "FINISHED" for result in self.results) else "FINISHED"


def main(argv: list[str]) -> int:
    """Check everything, then run, then say where the runs lie and what to type next."""
    words = Words.parse(argv, flags=("-m", "--multirun"))
    if words.help:
        print(help_text("train", "[-m] [group=option] [key=value] ...", words.config_dirs))
        return 0
    multirun = bool(words.flags)
    if not multirun and (swept := [text for text in words.overrides if registry.is_sweep(text)]):
        raise UserError(f"{swept[0]!r} names several values: add -m to run a sweep, or give one")
    configs = checked_jobs(words, multirun)

    from credit import schema
    from credit.job import Job, plan
    from credit.runner import place
    from credit.session import Session

    for config, overrides in configs:
        place(config, overrides)
    first = configs[0][0]
    session = Session.begin(
        Job.of(first).folder,
        "sweep" if multirun else "job",
        first["experiment"],
        ["train", *argv],
        first["tracking"],
        [plan(config, overrides) for config, overrides in configs],
        words.config_dirs,
    )
    tracking = schema.build(first, "tracking")
    tracking.start(session.folder, session.output)
    console = Console(stderr=True, highlight=False)
    outcome, status = Outcome(), "KILLED"
    try:
        with interruptible(), bars(console, len(configs)) as bar:
            launch(words, multirun, session, outcome, bar, console)
        status = outcome.status
    finally:
        session.finish(status)
        late = drain(tracking, console)
    report(outcome, session, first, multirun, late)
    return 0 if status == "FINISHED" else 1


def checked_jobs(words: Words, multirun: bool) -> list[tuple[dict[str, Any], list[str]]]:
    """The checked configuration and the overrides of every job.

    Raises:
        UserError: with the problems of all jobs, each once.
    """
    from credit.job import checked

    jobs = registry.expand(words.overrides) if multirun else [words.overrides]
    found, problems, remarks = [], {}, dict[str, None]()
    for overrides in jobs:
        try:
            config = checked(registry.compose(overrides, words.config_dirs), lambda text: remarks.setdefault(text))
            found.append((config, overrides))
        except UserError as error:
            problems.update(dict.fromkeys(str(error).splitlines()))
    if problems:
        raise UserError("\n".join(problems))
    for remark in remarks:
        print(f"note     {remark}", file=sys.stderr)
    return found


def launch(words: Words, multirun: bool, session: Any, outcome: Outcome, bar: Any, console: Console) -> None:
    """Hand the job or the sweep to Hydra."""
    from credit.job import checked
    from credit.runner import run_job

    def task(composed: Any) -> str:
        """One job, as Hydra composed it."""
        config = checked(registry.plain(composed))
        number, overrides = registry.job_overrides()
        overrides = [text for text in overrides if not text.startswith("session=")]
        result = run_job(config, overrides, session, number, bar)
        outcome.results.append(result)
        say(console, config, result, session)
        return result.status

    registry.launch(task, [*words.overrides, f"session={session.id}"], multirun, words.config_dirs)


def say(console: Console, config: dict[str, Any], result: Any, session: Any) -> None:
    """One line about a job that has just ended."""
    name = f"{result.title} on {config['experiment']}"
    done = f", {len(result.skipped)} already done" if result.skipped else ""
    if result.error:
        line = f"[red]failed[/red]  {name}: {result.error} (traceback: {shown(session.folder / 'error.log')})"
    elif result.computed:
        values = [f"{key} {result.metrics[key].mean():.4g}" for key in HEADLINES if key in result.metrics]
        took = f"{len(result.computed)} seeds in {result.seconds:.1f} s{done}"
        line = f"[green]done[/green]    {name}: {took}. {', '.join(values)}"
    else:
        line = f"[green]done[/green]    {name}: all {len(result.skipped)} seeds were done before"
    console.print(line, soft_wrap=True)


def report(outcome: Outcome, session: Any, config: dict[str, Any], multirun: bool, late: str | None) -> None:
    """Where the runs lie and what to type next."""
    parents = sorted({folder.parent for result in outcome.results for folder in result.folders})
    for parent in parents:
        print(f"runs     {shown(parent)}/seed-*")
    if late:
        print(f"tracking {late}")
    elsewhere = "" if config["output"] == "outputs" else f" output={shlex.quote(str(config['output']))}"
    print(f"next     credit compare experiment={config['experiment']}{elsewhere}")
    if config["tracking"]["_target_"] != "credit.tracking.NoTracking":
        print(f"         credit dashboard{elsewhere}")


def shown(path: Path) -> Path:
    """A path relative to the working folder where it lies inside it."""
    with contextlib.suppress(ValueError):
        return path.relative_to(Path.cwd())
    return path


@contextlib.contextmanager
def bars(console: Console, jobs: int) -> Iterator[Any]:
    """A progress bar for the job that runs; quiet when the output is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"))
    with Progress(
        *columns,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task, job, before = None, 0, 0

        def advance(title: str, steps: int, total: int) -> None:
            """Show how far the job is; the title says what it has come to."""
            nonlocal task, job, before
            begun = task is None or steps < before
            job += begun
            shown = f"{title} ({job} of {jobs})" if jobs > 1 else title
            if begun and task is not None:
                progress.remove_task(task)
            if task is None or begun:
                task = progress.add_task(shown, total=total)
            progress.update(task, completed=steps, description=shown)
            before = steps

        yield advance


def drain(tracking: Any, console: Console) -> str | None:
    """Wait for what is still to be uploaded."""
    with console.status("MLflow") if console.is_terminal else contextlib.nullcontext() as status:

        def progress(done: int, total: int) -> None:
            if status is not None:
                status.update(f"MLflow: {done} of {total} rows")

        late: str | None = tracking.finish(timeout=120.0, on_progress=progress)
    return late


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """A SIGTERM ends a run as Ctrl-C does: journals closed, status KILLED."""

    def stop(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(guarded("train", sys.argv[1:]))

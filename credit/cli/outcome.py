"""What is said of jobs that have ended: a line each, and a table, the best first."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Column, Table

from credit.runs.headlines import HEADLINES, main_of

COLOURS = {"done": "green", "done before": "green", "failed": "red", "killed": "yellow", "not run": "yellow"}
UNITS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))
SHOWN = 3  # metrics in a line

Job = tuple[dict[str, Any], list[str]]


def differing(jobs: Mapping[int, Job]) -> dict[int, list[str]]:
    """The words of each job that not all jobs have, without the method, which its title tells."""
    shared = set.intersection(*(set(overrides) for _, overrides in jobs.values()))
    return {
        number: [text for text in overrides if text not in shared and not text.startswith("method=")]
        for number, (_, overrides) in jobs.items()
    }


def line(facts: dict[str, Any], config: dict[str, Any], words: Sequence[str], log: Path) -> str:
    """One line about a job that has just ended; `words` are those by which it differs from the others."""
    name = escape(f"{facts['title']} on {config['experiment']}" + (f" ({' '.join(words)})" if words else ""))
    if facts["status"] == "KILLED":
        return f"[yellow]killed[/yellow]  {name}: interrupted; the same command goes on with it"
    if facts["status"] != "FINISHED":
        where = f" (traceback: {shown(log)})" if log.exists() else ""
        return f"[red]failed[/red]  {name}: {escape(facts['error'] + where)}"
    if not facts["computed"]:
        return f"[green]done[/green]    {name}: all {facts['skipped']} seeds were done before"
    done = f", {facts['skipped']} already done" if facts["skipped"] else ""
    resumed = f", {facts['resumed']} of them resumed" if facts["resumed"] else ""
    numbers = _numbers(facts)
    values = ", ".join(f"{key} {numbers[key]:.4g}" for key in [*numbers][:SHOWN])
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
    """All jobs: status, method, the words by which they differ, main metric; the best of each experiment first."""
    rows, words = [], differing(jobs)
    for number, (config, _) in jobs.items():
        job = facts.get(number)
        metric = main_of(found := _numbers(job) if job else {})
        value = found.get(metric or "", math.nan)
        rank = math.inf if math.isnan(value) else value if HEADLINES[metric or ""] else -value
        rows.append((config["experiment"], rank, number, metric, value))
    (metric,) = shown_metrics if len(shown_metrics := {row[3] for row in rows if row[3]}) == 1 else ("metric",)
    told = any(words.values())
    names = ("method", *(["differs by"] if told else []), metric.replace("/", "/\n"), "seeds", "s")
    columns = [Column("job"), Column("status"), *(Column(name, overflow="fold") for name in names)]
    found_table = Table(*columns, box=None, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for _, _, number, own, value in sorted(rows):
        config, job = jobs[number][0], facts.get(number)
        word = status(job)
        seeds = f"{config['seed']}–{config['seed'] + config['replicas'] - 1}"
        shown_value = "" if math.isnan(value) else f"{value:.4g}" if metric != "metric" else f"{own} {value:.4g}"
        seconds = f"{job['seconds']:.1f}" if job and "seconds" in job else ""
        differs = [escape(" ".join(words[number]))] if told else []
        cells = (escape(config["title"]), *differs, shown_value, seeds, seconds)
        found_table.add_row(str(number), f"[{COLOURS[word]}]{word}[/]", *cells)
    return found_table


def _numbers(facts: dict[str, Any]) -> dict[str, float]:
    """A job's values; JSON has no NaN."""
    return {key: math.nan if value is None else value for key, value in facts.get("values", {}).items()}


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


def duration(seconds: float) -> str:
    """A time in its two largest units."""
    left = round(seconds)
    parts: list[str] = []
    for size, unit in UNITS:
        count, left = divmod(left, size)
        if count or parts:
            parts.append(f"{count} {unit}")
    return " ".join(parts[:2]) or "0 s"

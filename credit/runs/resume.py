"""Finish what was interrupted, from its folder alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from credit.config import schema
from credit.core.errors import UserError
from credit.runs import folders
from credit.runs import job as jobs
from credit.runs.differing import labels
from credit.runs.runner import Progress, Result, run_job
from credit.runs.session import Session
from credit.runs.threads import limited


def resume(
    folder: str | Path, progress: Progress | None = None, *, threads: int | None = None, signals: bool = False
) -> list[Result]:
    """Go on with the unfinished runs in or below a folder; those that were computed side by side are again.

    Args:
        folder: a run's folder, or one with runs below it. progress, threads, signals: as in `credit.run`.

    Returns:
        One result a job; none where all is done.

    Raises:
        UserError: no run lies there, one is being computed now, or a checkpoint cannot be read; nothing was changed.

    Example:
        >>> credit.resume("outputs/advertiser/disagreement/default/seed-3")
    """
    found = interrupted(Path(folder).resolve())
    for config, parent in found:
        if holder := folders.running(config, parent):
            raise UserError(f"{folder}: {holder}; wait for it, or stop it first")
    if not found:
        return []
    first, parent = found[0]
    output, kind = parent.parents[2], "job" if len(found) == 1 else "sweep"
    plan = [jobs.plan(config) for config, _ in found]
    with limited(threads):
        words, told = ["resume", str(folder)], labels([config for config, _ in found])
        session = Session.begin(output, kind, first["experiment"], words, first["tracking"], plan, labels=told)
        tracking = schema.build(first, "tracking")
        tracking.start(session.folder, output)
        status, results = "KILLED", list[Result]()
        try:
            for number, (config, place) in enumerate(found):
                results.append(run_job(config, [], session, number, progress, place, signals=signals))
            status = "FAILED" if any(result.status != "FINISHED" for result in results) else "FINISHED"
        finally:
            session.finish(status)
            tracking.finish()
    return results


def interrupted(folder: Path) -> list[tuple[dict[str, Any], Path]]:
    """The jobs that are left in or below a folder: checked configuration and the folder of its runs.

    Raises:
        UserError: no run lies there.
    """
    own = folder / "config.yaml"
    files = [file for file in ([own] if own.exists() else sorted(folder.rglob("seed-*/config.yaml"))) if _seed(file)]
    if not files:
        raise UserError(f"{folder}: no run lies here or below (a run's folder has a config.yaml)")
    left: dict[Path, list[int]] = {}
    for file in files:
        if not (file.parent / "DONE").exists():
            left.setdefault(file.parents[1], []).append(int(str(_seed(file))))
    found = []
    for parent, seeds in left.items():
        for first, count in spans(sorted(seeds)):
            config = jobs.read(parent / f"seed-{first}") | {
                "output": str(parent.parents[2]),
                "slug": parent.name,
                "seed": first,
                "replicas": count,
            }
            found.append((jobs.checked(config), parent))
    return found


def _seed(file: Path) -> str | None:
    """The number in the name of a run's folder, where it lies as runs do: experiment/method/slug/seed-<n>."""
    number = file.parent.name.removeprefix("seed-")
    return number if number.isdecimal() and len(file.parents) > 4 else None


def spans(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Rising numbers as runs without gaps: first and length.

    Example:
        >>> spans([0, 1, 2, 7])
        [(0, 3), (7, 1)]
    """
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and sum(found[-1]) == number:
            found[-1] = found[-1][0], found[-1][1] + 1
        else:
            found.append((number, 1))
    return found

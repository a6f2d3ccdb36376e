"""`credit resume DIR`: finish a run, the runs below a folder, or a whole sweep, from its folder alone."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

from credit.cli.common import Words
from credit.cli.main import guarded
from credit.core.errors import UserError
from credit.runs.journal import read_json

USAGE = """usage: credit resume DIR

DIR is a run's folder (…/seed-3), a folder with runs below it, or the folder of a `credit train` (…/sessions/<id>):
then its jobs that have not begun are run, too."""


def main(argv: list[str]) -> int:
    """Go on with what is not finished; 0 where all is done in the end."""
    words = Words.parse(argv)
    if words.help:
        print(USAGE)
        return 0
    if len(words.overrides) != 1:
        raise UserError(f"one folder is needed, got {words.overrides or 'none'}\n{USAGE}")
    folder = Path(words.overrides[0]).resolve()
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    if (folder / "session.json").exists():
        return _session(folder)
    return _runs(folder)


def _session(folder: Path) -> int:
    """The command of a session once more, with its output folder where it lies now."""
    from credit.cli import train
    from credit.config.quoting import quoted
    from credit.runs import job
    from credit.runs.locks import Lock

    facts = read_json(folder / "session.json")
    if (lock := Lock(folder / ".lock")).held_elsewhere():
        raise UserError(
            f"{folder}: `{facts['command']}` is still at work ({lock.holder()}); wait for its end, or end it "
            "(Ctrl-C, or SIGTERM to that process) and resume then"
        )
    command, *argv = facts["argv"]
    if command != "train":
        raise UserError(
            f"{folder}: the session of `{facts['command']}`, whose runs can be gone on with by their folders"
        )
    words = Words.parse(argv, flags=("-m", "--multirun"))
    overrides = [text for text in words.overrides if not text.startswith("output=")]
    overrides.append(f"output={quoted(str(folder.parents[1]))}")
    words = dataclasses.replace(words, overrides=overrides, config_dirs=facts["config_dirs"])
    now = [job.plan(config) for config, _ in train.checked_jobs(words, train.several(words))]
    if now != facts["plan"]:
        raise UserError(
            f"{folder}: `{facts['command']}` means other jobs than when it was typed, since the configuration of "
            f"credit has changed: {_changes(folder, facts['plan'], now)}; finish its runs by their folders"
        )
    dirs = [f"--config-dir={path}" for path in facts["config_dirs"]]
    return train.main([*words.flags, *dirs, *overrides])


def _changes(folder: Path, before: list[dict[str, Any]], now: list[dict[str, Any]]) -> str:
    if len(before) != len(now):
        return f"{len(before)} jobs then, {len(now)} now"
    numbers = [str(number) for number, (old, new) in enumerate(zip(before, now, strict=True)) if old != new]
    return f"job {', '.join(numbers)} (their configurations lie in {folder})"


def _runs(folder: Path) -> int:
    """Every unfinished run in or below a folder."""
    from credit.cli.task import interruptible
    from credit.runs.resume import resume

    with interruptible(True):
        results = resume(folder, threads=1, signals=True)
    for result in results:
        seeds = f"{len(result.computed)} seeds, {len(result.resumed)} of them resumed"
        line = f"failed   {result.title}: {result.error}" if result.error else f"done     {result.title}: {seeds}"
        print(line)
    if not results:
        print("all runs were done before")
    return int(any(result.status != "FINISHED" for result in results))


if __name__ == "__main__":
    sys.exit(guarded("resume", sys.argv[1:]))

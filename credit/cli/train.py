"""`credit train`: one job, or a sweep with -m."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from credit.cli.common import CFG, PARTS, Words, help_text
from credit.cli.follow import Follower
from credit.cli.launching import Begun
from credit.cli.main import guarded, nothing_begun
from credit.cli.outcome import Job, counts, shown, table
from credit.cli.output import page
from credit.config import launchers, registry, sweeps
from credit.core.errors import UnknownKey, UserError


def main(argv: list[str]) -> int:
    """Check everything, then run, then say how it went, where the runs lie and what to type next."""
    words = Words.parse(argv, flags=("-m", "--multirun", CFG))
    if words.help:
        print(help_text("train", f"[-m | {CFG} {'|'.join(PARTS)}] [group=option] [key=value] ...", words.config_dirs))
        return 0
    if words.part:
        from credit.cli.check import configuration

        return configuration(words)
    registry.require_words(words.overrides)
    multirun = several(words)
    if not multirun and (swept := [text for text in words.overrides if registry.is_sweep(text)]):
        raise UserError(f"{swept[0]!r} names several values: add -m to run a sweep, or give one")
    with nothing_begun("train"):
        print("start    checking what was typed", file=sys.stderr, flush=True)
        jobs = checked_jobs(words, multirun)
    console = Console(stderr=True, highlight=False)
    ended, late, parents, session = computed(words, jobs, ["train", *argv], console, multirun)
    report(parents, jobs[0][0], late, None if ended == "FINISHED" else session)
    return 0 if ended == "FINISHED" else 1


def computed(
    words: Words, jobs: list[Job], argv: list[str], console: Console, multirun: bool, told: bool = True
) -> tuple[str, str | None, list[Path], Path]:
    """Run checked jobs.

    Args:
        words, jobs: what was typed, and what it comes to. argv: as the session is told it. console: where news go.
        multirun: whether it is a sweep. told: whether a sweep's table is printed at the end.

    Returns:
        The session's status, what is still to be uploaded, the folders of the runs, and that of the session.
    """
    from credit.runs.differing import labels
    from credit.runs.job import plan
    from credit.runs.runner import place

    launcher = launchers.choose(words.overrides, len(jobs), uses_gpu(jobs), words.config_dirs)
    numbered = dict(enumerate(jobs))
    parents = {place(config): None for config, _ in jobs}
    plans, named = [plan(config) for config, _ in jobs], labels([config for config, _ in jobs])
    begun = Begun(words, launcher, argv, jobs[0][0], plans, console, multirun, labels=named)
    try:
        with begun:
            stands = begun.launch(numbered)
            begun.ended = "FINISHED" if {*stands.values()} <= {"done", "done before"} else "FAILED"
    finally:
        if multirun and told:
            show(begun.follower, numbered)
        late = begun.finish()
    return begun.ended, late, [*parents], begun.session.folder


def several(words: Words) -> bool:
    """Whether the command is a sweep: `-m`, or a sweep from a file, which is nothing else."""
    return bool(words.flags) or any(registry.is_sweep_file(text) for text in words.overrides)


def checked_jobs(words: Words, multirun: bool) -> list[Job]:
    """The checked configuration and the overrides of every job; of a sweep's jobs that are one, the first.

    A word has an effect in at least one job; in a sweep, jobs in which it has none are what they are without it.

    Raises:
        UserError: with the problems of all jobs, each once.
    """
    from credit.runs.composing import compose

    jobs = sweeps.expand(words.overrides, words.config_dirs) if multirun else [words.overrides]
    found, remarks = dict[str, Job](), dict[str, None]()
    problems: dict[str, list[list[str]]] = {}  # what is wrong → the jobs in which it is
    useful: set[str] = set()
    useless: dict[str, tuple[str, list[str]]] = {}  # word → its slot, and a job that it is in
    for overrides in jobs:
        without: dict[str, str] = {}
        try:
            idle = without.update if multirun else None
            config = compose(overrides, config_dirs=words.config_dirs, say=remarks.setdefault, idle=idle)
        except UserError as error:
            for line in str(error).splitlines():
                problems.setdefault(line, []).append(overrides)
            continue
        from credit.runs.job import plan  # with all that runs

        kept = [word for word in overrides if word not in without]
        found.setdefault(json.dumps(plan(config) | {"slug": None}), (config, kept))  # one run may be typed in two ways
        useful.update(kept)
        useless |= {word: (slot, overrides) for word, slot in without.items()}
    for word, (slot, overrides) in useless.items():
        if word not in useful:
            from credit.runs import effects

            try:
                said = effects.said(word, slot, overrides, words.config_dirs)
            except UnknownKey as error:  # of a part that no job has
                said = str(error)
            problems |= dict.fromkeys(said.splitlines(), jobs)
    if problems:
        raise UserError("\n".join(located(line, wrong, jobs) for line, wrong in problems.items()))
    for remark in remarks:
        print(f"note     {remark}", file=sys.stderr)
    return list(found.values())


def located(problem: str, wrong: list[list[str]], jobs: list[list[str]]) -> str:
    """A problem of some jobs of a sweep, with the words that only they have, or the first of them."""
    if len(wrong) == len(jobs):
        return problem
    shared = set(wrong[0]).intersection(*wrong)
    others = {word for job in jobs if job not in wrong for word in job}
    words = [word for word in wrong[0] if word in shared - others]
    words = words or [word for word in wrong[0] if not all(word in job for job in jobs)]
    return f"{problem} (with {' '.join(words)})" if any(word not in problem for word in words) else problem


def uses_gpu(jobs: list[Job]) -> bool:
    """Whether any job runs on a GPU."""
    from credit.runs.job import device

    return any(device(config["device"]).type == "cuda" for config, _ in jobs)


def show(follower: Follower, jobs: Mapping[int, Job]) -> None:
    """The table of all jobs, and how many of each kind."""
    page(markup=True).print(table(follower.facts, jobs))
    print("\n".join(counts(follower.facts, jobs)))


def report(parents: list[Any], config: dict[str, Any], late: str | None, failed: Path | None) -> None:
    """Where the runs lie and what to type next: `failed` is the folder of a session that has jobs to be done again."""
    for parent in sorted(parents):
        print(f"runs     {shown(parent)}/seed-*")
    if late:
        print(f"tracking {late}")
    elsewhere = "" if config["output"] == "outputs" else f" output={shlex.quote(str(config['output']))}"
    if failed:
        print(f"next     mend what failed, then credit resume {shlex.quote(str(shown(failed)))}")
    else:
        print(f"next     credit compare experiment={config['experiment']}{elsewhere}")
    from credit.config import schema

    if look := schema.build(config, "tracking").look(Path(config["output"])):
        print(f"         {look}")


if __name__ == "__main__":
    sys.exit(guarded("train", sys.argv[1:]))

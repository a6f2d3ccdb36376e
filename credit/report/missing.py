"""What to say where there are no runs to compare: what there is, and a command that makes what was asked for."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from credit.core.errors import UserError, nearest
from credit.report.groups import PAPER_METHODS
from credit.report.published import load_paper
from credit.runs.offered import offered

OUTPUT = Path("outputs")  # where runs go unless told
EPISODIC = tuple(method for method in PAPER_METHODS if method != "block")  # which needs a task that goes on for ever


@dataclass(frozen=True)
class Asked:
    """What was asked for, as `load_runs` was: None is all."""

    output: Path
    experiment: str
    methods: Sequence[str] | None = None
    seed: int | None = None
    replicas: int | None = None

    def command(self, methods: Sequence[str]) -> str:
        """The command that trains these methods where, and on the seeds that, runs were looked for."""
        words = ["credit", "train", *(["-m"] if len(methods) > 1 else [])]
        words += [f"experiment={self.experiment}", f"method={','.join(methods)}"]
        words += [] if self.output == OUTPUT else [f"output={self.output}"]
        numbers = {"seed": self.seed, "replicas": self.replicas}
        return shlex.join([*words, *(f"{key}={number}" for key, number in numbers.items() if number is not None)])


def require_methods(asked: Asked, known: set[str]) -> None:
    """Stop where a method that was asked for has no finished run: one that there is can be trained.

    Args:
        asked: what was asked for. known: the methods with finished runs.

    Raises:
        UserError: with the nearest method that has runs, and a command where that helps.
    """
    missing = sorted(set(asked.methods or ()) - known)
    if not missing:
        return
    hints = "; ".join(f"method={name}: {nearest(name, known)}" for name in missing)
    said = f"No finished run of experiment={asked.experiment} that was asked for has {hints}."
    trained = [name for name in missing if name in offered("method")]
    if trained:
        said += f" Run `{asked.command(trained)}` first, or leave {'it' if len(missing) == 1 else 'them'} out."
    raise UserError(said)


def nothing_found(asked: Asked, finished: Sequence[Path], unfinished: Sequence[Path]) -> UserError:
    """The error where not a single finished run was found.

    Args:
        asked: what was asked for. finished: all finished runs of the experiment. unfinished: those that were asked for.
    """
    experiment, seen = asked.experiment, {folder.parents[2].name for folder in asked.output.glob("*/*/*/seed-*")}
    others = sorted(seen - {experiment})
    names = sorted({folder.parents[1].name for folder in unfinished or finished})
    if unfinished:
        found = f"Found {len(unfinished)} unfinished run(s) of {', '.join(names)}."
    elif finished:
        found = f"Finished runs exist for {', '.join(names)}, but not with these seeds and slugs."
    elif others:
        found = f"Found runs of {', '.join(others)} only."
    else:
        found = "Found no runs at all."
    said = f"No finished runs to compare for experiment={experiment} in {asked.output}. {found}"
    if others and not names:
        return UserError(f"{said} There are no runs of it; {nearest(experiment, others)}")
    if not names and experiment not in (known := offered("experiment")):
        return UserError(f"{said} There is no experiment of this name; {nearest(experiment, known)}")
    known = offered("method")
    if wrong := [name for name in asked.methods or () if name not in {*known, *names}]:
        hints = "; ".join(f"method={name}: there is none of this name, {nearest(name, known)}" for name in wrong)
        return UserError(f"{said} {hints}")
    methods = asked.methods or names or (PAPER_METHODS if load_paper(experiment) else EPISODIC)
    return UserError(f"{said} Run `{asked.command(methods)}` first.")

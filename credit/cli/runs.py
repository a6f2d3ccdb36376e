"""`credit runs`: what an output folder holds, filtered, and deleted where that is asked for."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from credit.cli.main import guarded
from credit.cli.words import Reader, names, read_words
from credit.core.errors import UserError
from credit.runs.catalogue import Runs, runs

HELP = """\
The runs of an output folder, a line for those that differ by their seed alone.

Usage: credit runs [KEY=VALUE ...] [--delete [--yes]]

  output=DIR          the output folder                                (outputs)
  experiment=A,B      only these; patterns such as 'Half*' are allowed
  method=A,B          likewise
  variant=A,B         likewise: what differs from the method, or default
  status=A,B          only done, unfinished or running ones
  --delete            delete those that are listed, after a question; name at least one of the keys above
  --yes               … without a question
"""
STATES = ("done", "unfinished", "running")
FILTERS = ("experiment", "method", "variant", "status")


def _states(text: str) -> list[str]:
    found = names(text)
    if not set(found) <= set(STATES):
        raise ValueError(text)
    return found


READERS: dict[str, Reader] = {
    "output": ("output", Path, "a folder"),
    **{name: (name, names, "names or patterns, with commas between them") for name in FILTERS[:3]},
    "status": ("status", _states, f"one or more of {', '.join(STATES)}"),
}


def main(argv: list[str]) -> int:
    """List runs, or delete them."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    flags = {word for word in argv if word.startswith("--")}
    if unknown := sorted(flags - {"--delete", "--yes"}):
        raise UserError(f"{unknown[0]!r} is no option here; valid: --delete, --yes, --help")
    if flags == {"--yes"}:
        raise UserError("--yes answers the question of --delete; there is none without it")
    given = read_words([word for word in argv if word not in flags], READERS, "runs")
    output = given.pop("output", Path("outputs"))
    found = [each for each in runs(output) if _asked(each, given)]
    if not found:
        raise UserError(f"output={output}: no such runs; `credit runs output={output}` lists all there are")
    print("\n".join(table(found)))
    if "--delete" in flags:
        if not given:
            raise UserError(f"--delete wants to know what: give {', '.join(f'{name}=…' for name in FILTERS)}")
        return delete(found, "--yes" in flags)
    return 0


def _asked(each: Runs, wanted: dict[str, list[str]]) -> bool:
    return all(
        any(fnmatchcase(getattr(each, name), pattern) for pattern in patterns) for name, patterns in wanted.items()
    )


def table(found: Sequence[Runs]) -> list[str]:
    """Columns of text: the runs of each job in a line."""
    rows = [("experiment", "method", "variant", "seeds", "status", "main metric", "MB", "written")]
    for each in found:
        metric = "" if each.metric is None else f"{each.metric} {each.value:.4g}"
        seeds = (
            f"{len(each.done)} of {len(each.done) + len(each.unfinished)}" if each.unfinished else f"{len(each.done)}"
        )
        written = time.strftime("%Y-%m-%d %H:%M", time.localtime(each.written))
        size = f"{each.bytes / 1e6:.1f}"
        rows.append((each.experiment, each.method, each.variant, seeds, each.status, metric, size, written))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def delete(found: Sequence[Runs], sure: bool) -> int:
    """Delete runs for ever, once the user has agreed; records of sessions and MLflow's stay.

    Raises:
        UserError: one of them is being computed, or there is nobody to ask.
    """
    if busy := [each for each in found if each.busy]:
        raise UserError(f"{busy[0].folder}: being computed now; wait, or stop it first. Nothing was deleted")
    folders = [folder for each in found for folder in (*each.done, *each.unfinished)]
    if not sure:
        if not sys.stdin.isatty():
            raise UserError("--delete asks, and nobody is here to answer: add --yes. Nothing was deleted")
        size = sum(each.bytes for each in found) / 1e6
        if input(f"delete these {len(folders)} runs, {size:.1f} MB, for ever? [y/N] ").strip().lower() not in (
            "y",
            "yes",
        ):
            print("nothing was deleted")
            return 0
    for each in found:
        for folder in (*each.done, *each.unfinished):
            shutil.rmtree(folder)
        _prune(each.folder)
    print(f"deleted {len(folders)} runs; what MLflow has of them stays there")
    return 0


def _prune(folder: Path) -> None:
    """Remove a folder and those around it, up to the experiment's, as long as they are empty."""
    for place in (folder, *folder.parents[:2]):
        if any(place.iterdir()):
            return
        place.rmdir()


if __name__ == "__main__":
    sys.exit(guarded("runs", sys.argv[1:]))

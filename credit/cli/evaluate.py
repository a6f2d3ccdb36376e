"""`credit evaluate RUN`: what the kept policies of finished runs are worth, also in a changed environment."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from credit.cli.main import guarded
from credit.cli.output import page
from credit.cli.words import Reader, read_words, whole
from credit.core.errors import UserError

HELP = """\
What the kept policies of finished runs are worth: return, label, and success where it is told.

Usage: credit evaluate RUN... [KEY=VALUE ...]

  RUN              the folder of a seed (…/seed-0), or of all seeds of a run; several are compared
  episodes=N       of each seed, with random numbers that no run has seen            (100)
  env.KEY=VALUE    another parameter of the environment, such as env.p_down=0.3
  policy=NAME      another of a run's policies: greedy, averaged                     (behaviour)
  seed=N           of the random numbers                                             (0)

Where the environment knows P and r, policies are judged exactly, without episodes.

Examples:
  credit evaluate outputs/advertiser/disagreement/default
  credit evaluate outputs/sepsis/{delayed,disagreement}/default env.horizon=8
  credit evaluate outputs/pointmaze/reference/default/seed-0 episodes=20 policy=averaged
"""
READERS: dict[str, Reader] = {
    "episodes": ("episodes", whole(1), "a whole number, 1 or more"),
    "policy": ("policy", str, "the name of a policy, such as greedy"),
    "seed": ("seed", whole(0), "a whole number, 0 or more"),
}


def main(argv: list[str]) -> int:
    """Evaluate, and print a row a run."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    folders, changes, options = split(argv, READERS, "evaluate")
    import pandas as pd
    from rich.console import Console
    from rich.table import Column, Table

    from credit.report.evaluated import caption, summary
    from credit.runs.evaluate import changed, evaluate, seeds_of
    from credit.runs.policies import read
    from credit.runs.threads import limited

    console, kinds = page(160), dict[bool, list[Any]]()
    places = [*dict.fromkeys(place for folder in folders for place in seeds_of(folder))]
    for place in places:
        changed(read(place)["config"], changes)  # all is looked at before the first is judged
    with limited(1), Console(stderr=True).status("evaluating") as status:
        for number, place in enumerate(places):  # one may be judged exactly, and the next not
            status.update(f"{place.parent.name}: {number + 1} of {len(places)}")
            found = evaluate(place, changes=changes, **options)
            kinds.setdefault(found.attrs["exact"], []).append(found)
    for exact, frames in kinds.items():
        found = pd.concat(frames)
        table, columns = summary(found), list(found.columns)
        shown = Table(Column("run", overflow="fold"), "seeds", *([] if exact else ["episodes"]), *columns, box=None)
        for run, row in table.iterrows():
            counts = [str(int(row[name])) for name in ("seeds", "episodes") if name in row]
            shown.add_row(str(run), *counts, *(written(row, name) for name in columns))
        console.print(shown)
        for line in caption(table, exact):
            console.print(line, soft_wrap=True)
    return 0


def written(row: Any, name: str) -> str:
    """A value with its interval."""
    if row[f"{name}_low"] != row[f"{name}_low"]:
        return f"{row[name]:.4g}"
    return f"{row[name]:.4g} [{row[f'{name}_low']:.4g}, {row[f'{name}_high']:.4g}]"


def split(
    argv: Sequence[str], readers: Mapping[str, Reader], command: str
) -> tuple[list[Path], dict[str, Any], dict[str, Any]]:
    """Folders (whose names may have = in them), parameters of the environment, and all other words as they are read.

    Raises:
        UserError: a word that cannot be read, or no folder.
    """
    folders, changes, rest = list[Path](), dict[str, Any](), list[str]()
    for word in argv:
        key, equals, text = word.partition("=")
        if word.startswith("-"):
            raise UserError(f"{word!r} is no option here; write KEY=VALUE, as `credit {command} --help` lists them")
        if Path(word).is_dir():
            folders.append(Path(word))
        elif "/" in key or not equals:
            raise UserError(f"{word}: there is no such folder; give that of a run, such as …/default/seed-0")
        elif key.startswith("env."):
            try:
                changes[key] = yaml.safe_load(text)
            except yaml.YAMLError:
                raise UserError(f"{word!r}: the value cannot be read; write it as for `credit train`") from None
        else:
            rest.append(word)
    options = read_words(rest, readers, command)
    if not folders:
        raise UserError(f"the folder of a run is needed; `credit {command} --help` says more")
    return folders, changes, options


if __name__ == "__main__":
    sys.exit(guarded("evaluate", sys.argv[1:]))

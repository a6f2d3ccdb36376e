"""`credit compare`: tables, intervals and figures from finished runs."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from credit.cli.main import guarded
from credit.cli.words import Reader, name, names, number, read_words, whole
from credit.core.errors import UserError

HELP = """\
Compare finished runs of an experiment: tables, intervals and figures.

Usage: credit compare [KEY=VALUE ...]

  experiment=NAME        the experiment whose runs are compared          (advertiser)
  method=A,B             only these methods                              (all)
  slug=A,B               only these variants; `default` has no overrides (all)
  feedback=A,B           only these settings; each is compared by itself (all)
  env.KEY=VALUE          only settings with this value, also of
                         feedback.KEY, trainer.KEY, demonstrations_from  (all)
  commit=A,B             only runs of these commits, by first digits     (all)
  seed=N                 the first seed                                  (all)
  replicas=N             how many seeds from there (or 0) on             (all)
  reference=METHOD       the method that the others are compared to      (reference)
  metric=NAME            rank methods by it, such as eval/return         (what their judge ranks by)
  trapped_above=X        final regret above which a seed is trapped      (300)
  diagnostics_seed=N     maps (and in a maze trajectories) of this seed  (mean; median seed)
  videos=true|false      film the final policies in a maze               (true)
  output=DIR             where runs lie and reports go                   (outputs)
  tracking=mlflow|none   log the report beside the training runs         (mlflow)

Examples:
  credit compare experiment=advertiser
  credit compare method=reference,disagreement seed=1000 replicas=100
  credit compare experiment=pointmaze env.maze=Large trainer.steps=26400
"""


def main(argv: list[str]) -> int:
    """Run the command.

    Args:
        argv: the words after `credit compare`.

    Returns:
        The exit code, 0.

    Raises:
        UserError: a key or a value is not valid, or there is nothing to compare.
    """
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    words, where = split_settings(argv)
    options = {"experiment": "advertiser", "output": Path("outputs"), **read_words(words, READERS, "compare")}
    tracked = options.pop("tracked", True)
    from rich.console import Console

    from credit.report.compare import compare
    from credit.report.tables import terminal_tables
    from credit.report.text import caption, heading, in_common, sentences

    report = compare(where=where, **options)
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 100
    for comparison in report.comparisons:
        if heading(comparison.runs):
            console.rule(heading(comparison.runs), align="left", characters="═")
        for table in terminal_tables(comparison, console.width):
            console.print(table, "")
        for line in sentences(comparison):
            console.print(line)
        if comparison is not report.comparisons[-1]:
            console.print()
    console.print(in_common(*report.comparisons), style="dim")
    console.print(caption(*report.comparisons), style="dim")
    console.print(f"\nTables and figures in {report.folder}:", soft_wrap=True)
    console.print("  " + "  ".join(path.name for path in report.files))
    if report.remark:
        console.print(report.remark, soft_wrap=True)
    if tracked:
        from credit.tracking.report_run import log_beside_runs

        logged = log_beside_runs(options["output"], options["experiment"], report.folder, report.metrics)
        console.print(logged, soft_wrap=True)
    return 0


def split_settings(argv: list[str]) -> tuple[list[str], dict[str, Any]]:
    """Words that choose settings, `env.maze=Large`, apart from the others, as `credit train` would read their values.

    Args:
        argv: the words after `credit compare`.

    Returns:
        The other words, and key → value.

    Raises:
        UserError: a value cannot be read.
    """
    words, where = list[str](), dict[str, Any]()
    for word in argv:
        key, equals, text = word.partition("=")
        if not (equals and key.startswith(("env.", "feedback.", "trainer.", "demonstrations_from"))):
            words.append(word)
            continue
        try:
            value = yaml.safe_load(text)
            with suppress(ValueError):
                value = float(value) if isinstance(value, str) else value  # 1e-3 is a text in YAML, and no number
            where[key] = value
        except yaml.YAMLError:
            raise UserError(f"{word!r}: the value cannot be read; write it as for `credit train`") from None
    return words, where


def _tracked(text: str) -> bool:
    return {"mlflow": True, "none": False}[text]


def _switch(text: str) -> bool:
    return {"true": True, "false": False}[text]


# key → argument of `compare`, or of `main`, how its text is read, what is allowed
READERS: dict[str, Reader] = {
    "experiment": ("experiment", name, "one name"),
    "method": ("methods", names, "names separated by commas"),
    "slug": ("slugs", names, "names separated by commas"),
    "feedback": ("feedback", names, "names separated by commas"),
    "commit": ("commits", names, "first digits of commits, separated by commas"),
    "seed": ("seed", whole(0), "a whole number, 0 or more"),
    "replicas": ("replicas", whole(1), "a whole number, 1 or more"),
    "reference": ("reference", name, "one name"),
    "metric": ("metric", str, "the name of a metric, such as eval/return"),
    "trapped_above": ("trapped_above", number, "a finite number"),
    "diagnostics_seed": ("diagnostics_seed", whole(0), "a whole number, 0 or more"),
    "videos": ("videos", _switch, "true or false"),
    "output": ("output", Path, "a folder"),
    "tracking": ("tracked", _tracked, "mlflow or none"),
}


if __name__ == "__main__":
    sys.exit(guarded("compare", sys.argv[1:]))

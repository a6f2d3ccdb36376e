"""`credit compare`: tables, intervals and figures from finished runs."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from credit.cli.main import guarded
from credit.cli.output import page
from credit.cli.words import Reader, given, name, names, number, read_words, whole
from credit.core.errors import UserError

HELP = """\
Compare finished runs of an experiment: tables, intervals and figures.

Usage: credit compare [KEY=VALUE ...]

  experiment=NAME        the experiment whose runs are compared          (advertiser)
  method=A,B             only these methods                              (all)
  variant=NAME           only this variant; `default` has no overrides   (all)
                         (may be given several times; or A,B, where that cannot be one name)
  slug=NAME              the same                                        (all)
  feedback=A,B           only these settings; each is compared by itself (all)
  env.KEY=VALUE          only settings with this value, also of
                         feedback.KEY, trainer.KEY, demonstrations_from  (all)
  commit=A,B             only runs of these commits, by first digits     (all)
  seed=N                 the first seed                                  (all)
  replicas=N             how many seeds from there (or 0) on             (all)
  reference=NAME         what the others are compared to, METHOD, VARIANT or METHOD/VARIANT
                                                                         (reference, or the only method)
  metric=NAME            rank methods by it, such as eval/return         (what their judge ranks by)
  sort=NAME              order the rows by this metric, the best first   (as in the paper)
  best=N                 only the N best by the ranking metric, and the reference
                                                                         (all)
  trapped_above=X        final regret above which a seed is trapped      (300)
  diagnostics_seed=N     maps (and in a maze trajectories) of this seed  (mean; median seed)
  videos=true|false      film the final policies in a maze               (true)
  output=DIR             where runs lie                                  (outputs)
  report=DIR             where the report goes         (reports/EXPERIMENT there, with what was chosen)
  tracking=mlflow|none   log the report beside the training runs         (mlflow)

Examples:
  credit compare experiment=advertiser
  credit compare method=reference,disagreement seed=1000 replicas=100
  credit compare experiment=pointmaze env.maze=Large trainer.steps=26400
  credit compare method=disagreement best=3 reference=mixer.alpha=0.1,uncertainty.draws=10
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
    named = [word for word in words if word.startswith(tuple(f"{key}=" for key in VARIANTS))]
    words = [word for word in words if word not in named]
    options = {"experiment": "advertiser", "output": Path("outputs"), **read_words(words, READERS, "compare")}
    tracked = options.pop("tracked", True)
    from credit.report.compare import compare
    from credit.report.terminal import terminal_tables
    from credit.report.text import caption, heading, in_common, sentences

    report = compare(where=where, slugs=[word.partition("=")[2] for word in named] or None, **options)
    console = page()
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

        logged = log_beside_runs(options["output"], options["experiment"], report.folder, report.headline)
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
            if key in where:
                raise UserError(f"{key} is given twice, the second time in {word!r}")
            where[key] = value
        except yaml.YAMLError:
            raise UserError(f"{word!r}: the value cannot be read; write it as for `credit train`") from None
    return words, where


def _tracked(text: str) -> bool:
    return {"mlflow": True, "none": False}[text]


def _switch(text: str) -> bool:
    return {"true": True, "false": False}[text]


VARIANTS = ("variant", "slug")  # the second is what a variant's name is called in run folders
# key → argument of `compare`, or of `main`, how its text is read, what is allowed
READERS: dict[str, Reader] = {
    "experiment": ("experiment", name, "one name"),
    "method": ("methods", names, "names separated by commas"),
    **dict.fromkeys(VARIANTS, ("slugs", given, "the name of a variant")),
    "feedback": ("feedback", names, "names separated by commas"),
    "commit": ("commits", names, "first digits of commits, separated by commas"),
    "seed": ("seed", whole(0), "a whole number, 0 or more"),
    "replicas": ("replicas", whole(1), "a whole number, 1 or more"),
    "reference": ("reference", given, "the name of a method or variant"),
    "metric": ("metric", given, "the name of a metric, such as eval/return"),
    "sort": ("sort", given, "the name of a metric, such as eval/return"),
    "best": ("best", whole(1), "a whole number, 1 or more"),
    "trapped_above": ("trapped_above", number, "a finite number"),
    "diagnostics_seed": ("diagnostics_seed", whole(0), "a whole number, 0 or more"),
    "videos": ("videos", _switch, "true or false"),
    "output": ("output", Path, "a folder"),
    "report": ("report", lambda text: Path(given(text)), "a folder"),
    "tracking": ("tracked", _tracked, "mlflow or none"),
}


if __name__ == "__main__":
    sys.exit(guarded("compare", sys.argv[1:]))

"""`credit tune`: search for the best setting on some seeds, and compare it with the default on others."""

from __future__ import annotations

import difflib
import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from credit.cli.common import Words
from credit.cli.main import guarded
from credit.cli.words import Reader, given, name, number, read_words, whole
from credit.core import signatures
from credit.core.errors import UserError
from credit.core.ranges import Name, NonNegativeInt, Positive, PositiveInt

if TYPE_CHECKING:
    from credit.cli.search import Search

HELP = """\
Search for the best setting of a method on some seeds, and compare it with the default on others.

Usage: credit tune [group=option] [key=value] ... [--config-dir DIR]

  key='interval(LOW,HIGH)'           a number between the two; a whole one where the key wants that
  key='tag(log,interval(LOW,HIGH))'  the same, evenly in its logarithm
  key='range(FROM,TO,STEP)'          numbers at equal steps, TO left out, as in a sweep
  key=A,B,C                          one of these; also group=option,option
  other words                        as in `credit train`, the same in all trials
  seed=N replicas=N                  the seeds that are tuned on: each trial runs on all of them

  trials=N           trials in all, those of earlier commands too            (20)
  metric=NAME        what is tuned: its mean over the seeds                  (what the judge ranks by)
  sampler=NAME       Optuna's: tpe, random, cmaes, or grid for every setting (tpe)
  at_once=N          trials that run side by side; more are chosen knowing less (1)
  timeout=SECONDS    begin no trial after so long                            (none)
  report_seed=N      first seed of the report, which is never tuned on       (1000)
  report_replicas=N  how many; 0: no report                                  (20)
  study=NAME         the study's folder in OUTPUT/tuning                     (EXPERIMENT-METHOD)

The first trial is the default, where it lies in what is searched. The same command goes on with a study that was
interrupted; with more trials=… it goes on with one that was not. Trials are runs like others, and are never run twice.

Examples:
  credit tune method=disagreement mixer.alpha='interval(.1,1)' seed=0 replicas=10
  credit tune env=gymnasium env.id=CartPole-v1 agent.learning_rate='tag(log,interval(1e-4,1e-2))' replicas=3
  credit tune method=adaptive_mse mixer=best,relative_mse,stacking sampler=grid
"""
READERS: dict[str, Reader] = {
    "trials": ("trials", whole(1), "a whole number, 1 or more"),
    "metric": ("metric", given, "the name of a metric, such as eval/return"),
    "sampler": ("sampler", name, "one of tpe, random, cmaes, grid"),
    "at_once": ("at_once", whole(1), "a whole number, 1 or more"),
    "timeout": ("timeout", number, "a number of seconds"),
    "report_seed": ("report_seed", whole(0), "a whole number, 0 or more"),
    "report_replicas": ("report_replicas", whole(0), "a whole number, 0 or more"),
    "study": ("study", name, "one name"),
}


@dataclass(frozen=True)
class Options:
    """What `credit tune` takes beside the words of runs; `credit tune --help` says what each is.

    Raises:
        UserError: a value is not allowed.
    """

    trials: PositiveInt = 20
    metric: str | None = None
    sampler: str = "tpe"
    at_once: PositiveInt = 1
    timeout: Positive | None = None
    report_seed: NonNegativeInt = 1000
    report_replicas: NonNegativeInt = 20
    study: Name | None = None

    def __post_init__(self) -> None:
        signatures.check(type(self).__init__, "tune", vars(self))


def main(argv: list[str]) -> int:
    """Run the command; 0 where the search and its report came to an end."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    from rich.console import Console

    own = [word for word in argv if word.partition("=")[0] in READERS]
    options = Options(**read_words(own, READERS, "tune"))
    search = prepared(Words.parse([word for word in argv if word not in own]), options)
    found = search.run(["tune", *argv], Console(stderr=True, highlight=False))
    from credit.cli.tuned import said

    said(search, found)
    return 0 if found.ended else 1


def prepared(words: Words, options: Options) -> Search:
    """A search that is right; nothing is made yet.

    Raises:
        UserError: with what is wrong.
    """
    if importlib.util.find_spec("optuna") is None:
        raise UserError("credit tune searches by Optuna, which is not installed; pip install 'credit-rl[tune]'")
    _require_words(words.overrides)
    from credit.cli.search import Search

    return Search(words, options)


def _require_words(overrides: Sequence[str]) -> None:
    """Refuse words that are near to those of this command, and several values of what is no setting of a method."""
    from credit.config import registry
    from credit.config.kinds import CHOICES, CIRCUMSTANCES, KINDS, STARTS

    registry.require_words(overrides)
    problems = []
    fixed = {*CHOICES, *CIRCUMSTANCES, *STARTS, "env", "feedback"}
    for text in overrides:
        key = text.partition("=")[0].lstrip("+")
        close = difflib.get_close_matches(key, READERS, n=1, cutoff=0.75)
        if close and key not in {*fixed, *KINDS}:
            problems.append(f"unknown key {key!r} (in {text!r}); did you mean {close[0]!r}?")
        elif registry.is_sweep_file(text):
            problems.append(f"{text!r} is a sweep of many jobs, and a search makes its own; leave it out")
        elif key in fixed and registry.is_sweep(text):
            problems.append(
                f"{text!r} is not searched: a search is of one method on one problem, and all its trials have the same "
                "seeds; give it one value"
            )
    if problems:
        raise UserError("\n".join(problems))


if __name__ == "__main__":
    sys.exit(guarded("tune", sys.argv[1:]))

"""`credit recover DATA`: per-step credit from logged data, without a simulator."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from credit.cli.main import guarded

if TYPE_CHECKING:
    from credit.cli.recovery_words import Request
    from credit.logged.panel import Panel
    from credit.logged.recovered import AnyModel

HELP = """\
Recover a reward for every row of a table from labels on windows of rows, with intervals, and where models disagree.

Usage: credit recover DATA [key=value] ... [-m] [--explain] [--config-dir DIR]
       credit recover NEW --model DIR [key=value] ... [--explain]

  DATA                   CSV or Parquet: a file, a folder, a pattern in quotes; the folder of a finished run; or a
                         Minari dataset: minari:NAME, or its folder

what the columns are; what is not said is guessed, and it is said what was (--explain: guess only, fit nothing)
  data.window=COLUMN     rows that share a label                        data.label=COLUMN  the label
  data.labels=FILE       a second table with one row a window           data.time=COLUMN   order of rows
  data.group=COLUMN      series of their own                            data.label_is=sum|mean|last|binary
  data.actions=[A,B]     what was done                                  data.states=[C,D]  what was there
  data.stock=[E]         levels, not flows                              data.missing=error|drop|mean
  data.baseline={A: 0}   what effects are counted from                  data.cost={A: COLUMN}
  data.calendar=[weekday,month]  what dates become                      data.randomised=[A]  data.propensity=COLUMN
  data.next_states=[C,D] behind each step (next_…, where there are)     data.sizes={C: 10}   whole numbers, 0 to 9
  data.steps=T           windows of a Minari dataset (an episode), whose labels are sums of its rewards

models: formulas as in R, with lag(x, k), adstock(x, decay), saturate(x, half), whose numbers are chosen where left out
  reference.formula='1 + price + adstock(tv)'                           (all columns)
  surrogates.NAME.formula='1 + price + bs(day, 4)'                      (actions alone)
  …regularization=NUMBER   λ in windows (chosen by contiguous folds)    …sign={tv: positive}
or registered reward models (`credit list reward`), with their keys; units are weighed for them as for formulas, unless
an uncertainty is named; experiment=NAME takes all models of an experiment, its uncertainty and mixer
  reference=dnn reference.width=32   surrogates.NAME=linear             uncertainty=ensemble uncertainty.KEY=VALUE
  mixer=NAME mixer.KEY=VALUE                                            (relative_mse)

how
  draws=200 level=.9 folds=5 gap=WINDOWS seed=0
  residual=ar1|uniform   how what is left of a label goes to its rows   (ar1)        rho=NUMBER (estimated)
  nonnegative=true       no balanced credit below 0                     (false)
  output=DIR             the result goes to DIR/recover/NAME            (outputs)
  name=NAME                                                             (the file's name)
  format=parquet|csv     of steps                                       (csv where DATA is CSV)
  tracking=mlflow|none                                                  (mlflow)
  hydra/launcher=ray     passes over several Parquet files as jobs, one a file: ray, slurm, local   (this process)
  from=FILE.yaml         keys as above, under those on the command line

-m runs one recovery for each of several values: credit recover sales.csv -m mixer=relative_mse,best

--model scores rows that were not fitted to, by the folder of a recovery; labels and windows may be missing. Of the keys
above it takes output, name, format, tracking, from, and data.window, label, labels, time, group, missing

Example:
  credit recover examples/marketing.csv
"""


def main(argv: list[str]) -> int:
    """Recover; 0 where it came to an end."""
    if {"-h", "--help"} & set(argv):
        print(HELP, end="")
        return 0
    from credit.cli.recovery_words import requests

    asked = requests(argv)
    if asked[0].model is not None:
        from credit.cli.recovery_model import score

        score(asked)
        return 0
    ready = list(_prepared(asked))
    for number, (one, panel, models) in enumerate(ready):
        if len(asked) > 1:
            print(f"[{number + 1}/{len(asked)}] {' '.join(one.words)}")
        _one(one, panel, models)
    return 0


def _prepared(asked: Sequence[Request]) -> Iterator[tuple[Request, Panel, list[AnyModel]]]:
    """What is asked, with opened tables and models: all that can be refused is, before the first fit."""
    from credit.cli.recovery_data import resolved
    from credit.cli.recovery_place import placed, settled
    from credit.logged.mixers import saved_mixer
    from credit.logged.tables.opening import opened
    from credit.logged.tables.sources import MEMORY
    from credit.logged.writing import Folder

    panels: dict[str, Panel] = {}  # the same words of data are the same table
    taken: list[Path] = []
    for one in asked:
        Folder.require_free(one.folder)
        saved_mixer(one.ask.mixer)
        words = repr((one.ask.data, one.launcher))
        if words not in panels:
            memory = 0 if one.launcher else MEMORY  # as files, however small they are
            panels[words] = opened(*resolved(one.data, one.ask.data), memory=memory)
        one.ask.require(panels[words])
        if one.launcher:
            _require_files(panels[words], one)
        models = one.ask.models(panels[words])
        place = placed(settled(one, panels[words], models), taken)
        taken.append(place.folder)
        yield place, panels[words], models


def _require_files(panel: Panel, asked: Request) -> None:
    """Refuse a launcher that would have nothing to launch.

    Raises:
        UserError: the table is one file, or a window or a group goes on from one file to the next.
    """
    from credit.config import launchers
    from credit.core.errors import UserError

    if len(panel.sections()) == 1:
        raise UserError(
            f"{asked.launcher[0]} has no effect: {panel.source} is one table, or its rows had to be sorted, and a job "
            "is one of several Parquet files in order; leave it out"
        )
    launchers.choose(asked.launcher, len(panel.sections()), False, asked.config_dirs)


@contextmanager
def _spread(asked: Request) -> Iterator[None]:
    """Passes over files as jobs, where a launcher was asked for."""
    if not asked.launcher:
        yield
        return
    from credit.cli.recovery_jobs import runner
    from credit.logged.spreading import spread_over

    place = asked.folder.with_name(f".{asked.folder.name}.jobs.{os.getpid()}")
    with spread_over(runner(asked.launcher, place, asked.config_dirs)):
        yield


def _one(asked: Request, panel: Panel, models: list[AnyModel]) -> None:
    from credit.cli.recovery_screen import explained, shown

    explained(panel, models, asked)
    if asked.explain:
        return
    from credit.cli.recovery_place import CONFIG, parameters, written
    from credit.cli.recovery_screen import progress
    from credit.logged.result import LoggedCredit
    from credit.logged.writing import Folder

    with _kept(asked), progress(), _spread(asked), Folder.made(asked.folder, asked.words) as folder:
        folder.write_text(CONFIG, written(asked))
        fitted = asked.ask.fit(panel, models)
        folder.write_model(fitted)  # first: Ctrl-C keeps it
        found = LoggedCredit.of(fitted)
        folder.write(found, asked.format)
    shown(found, asked.folder)
    if asked.tracked:
        from credit.tracking.report_run import log_folder

        metrics = found.metrics | found.worth
        print(log_folder(asked.output, "recover", asked.name, asked.folder, metrics, dict(parameters(asked.tree))))


@contextmanager
def _kept(asked: Request) -> Iterator[None]:
    """Say what Ctrl-C leaves."""
    try:
        yield
    except KeyboardInterrupt:
        from credit.logged.writing import STOPPED, Folder

        place = Folder.place(asked.folder, STOPPED)
        if (place / STOPPED).exists():
            print(
                f"the fit is kept: credit recover {asked.data} --model {place} name=NAME scores rows by it",
                file=sys.stderr,
            )
        raise


if __name__ == "__main__":
    sys.exit(guarded("recover", sys.argv[1:]))

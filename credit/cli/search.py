"""A search by Optuna whose trials are runs like others: on some seeds, and then the best and the default on others."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from credit.cli import train
from credit.cli.common import Words
from credit.cli.launching import Begun
from credit.cli.outcome import Job
from credit.cli.tune import Options
from credit.cli.tuned import Tuned, line, span, without
from credit.config import launchers, schema
from credit.core.errors import UserError, nearest
from credit.report.comparison import summarise
from credit.report.measures import directed
from credit.report.runs import load_runs
from credit.report.settings import values_of
from credit.runs.composing import compose
from credit.runs.job import Job as Facts
from credit.runs.job import identity, plan
from credit.runs.journal import read_json
from credit.runs.runner import place
from credit.tuning import samplers, space
from credit.tuning.study import Study, Trial

WELL = ("done", "done before")


class Search:
    """What is searched, and how. It is checked whole, and nothing is made.

    Args:
        words: those of runs, some with several values. options: all others.

    Raises:
        UserError: with what is wrong.
    """

    def __init__(self, words: Words, options: Options) -> None:
        self._options, self._dirs = options, words.config_dirs
        searched = space.searched(words.overrides)
        fixed = [word for word in words.overrides if word not in searched]
        self.default = compose(fixed, config_dirs=self._dirs)
        self.job = Facts.of(self.default)
        self.space = space.read(words.overrides, self.default, self._dirs)
        samplers.require(options.sampler, self.space)
        self.name = options.study or f"{self.job.experiment}-{self.job.method}"
        self.reported = range(options.report_seed, options.report_seed + options.report_replicas)
        if both := {*self.job.seeds} & {*self.reported}:
            raise UserError(
                f"seed {min(both)} is tuned on (seed={self.job.seed} replicas={self.job.replicas}) and reported on "
                f"(report_seed={options.report_seed} report_replicas={options.report_replicas}), and a setting looks "
                f"better than it is on the seeds that chose it; write report_seed={max(self.job.seeds) + 1}"
            )
        self._require_corners()
        self.metric, self.maximize = self._objective()
        self.words = Words(fixed, words.flags, words.config_dirs)
        self.launcher = launchers.choose(fixed, options.at_once, train.uses_gpu([(self.default, fixed)]), self._dirs)
        place(self.default)

    def _require_corners(self) -> None:
        """Refuse ends of intervals, and choices, that no run can have, and those that make another problem of it."""
        problems, problem = dict[str, str](), values_of(self.default)
        for corner in self.space.corners():
            words = self.space.words(corner)
            try:
                config = compose([*self.space.fixed, *words], config_dirs=self._dirs)
            except UserError as error:
                for said in str(error).splitlines():  # an unknown key is unknown at both ends
                    problems.setdefault(re.sub(r" \(in '[^']*'\)", "", said), said)
                continue
            now = values_of(config)
            others = [key for key in problem.keys() | now.keys() if problem.get(key) != now.get(key)]
            problems |= {
                key: f"{key} is a part of the problem or its budget, and settings of different ones cannot be "
                "compared; give it one value"
                for key in sorted(others)
            }
        if problems:
            raise UserError("\n".join(problems.values()))

    def _objective(self) -> tuple[str, bool]:
        """What is tuned, and whether more of it is better."""
        trainer = schema.build(self.default, "trainer")
        trainer.start(self.job.seeds if self.job.policy_from else self.job.seeds[:1])
        judge, wanted = trainer.judge, self._options.metric
        if wanted in (None, judge.metric):
            return judge.metric, judge.higher_is_better
        return wanted, not directed("metric", wanted).lower_is_better

    def study(self) -> Study:
        """The study, opened.

        Raises:
            UserError: it is one of something else, somebody goes on with it, or it is damaged.
        """
        return Study(
            self.job.folder, self.name, self.space, self.default, self.metric, self.maximize, self._options.sampler
        )

    def run(self, argv: list[str], console: Console) -> Tuned:
        """Search, or go on, and compare what was found.

        Args:
            argv: the words after `credit`. console: where news go.

        Raises:
            UserError: the study is one of something else, or runs do not know the metric.
            KeyboardInterrupt: after Ctrl-C; the same goes on with it.
        """
        with self.study() as study:
            ended = self._searched(study, argv, console)
            best = study.best
            found = Tuned(
                best=self.space.words(best.params) if best else [],
                number=best.number if best else None,
                metric=self.metric,
                trials=study.frame,
                folder=study.folder,
            )
        if best is None or not ended or not self.reported:
            return replace(found, ended=ended and best is not None)
        return self._compared(found, argv, console)

    def _searched(self, study: Study, argv: list[str], console: Console) -> bool:
        """Run trials until there are enough; whether none was stopped."""
        wanted = self._options.trials
        if self._options.sampler == "grid":
            wanted = min(wanted, self.space.count() or wanted)
        if study.ended >= wanted and not study.interrupted():
            return True
        what = {"study": self.name, "space": dict(self.space.typed), "metric": self.metric}
        begun = Begun(
            self.words,
            self.launcher,
            argv,
            self.default,
            [plan(self.default) | what],
            console,
            True,
            wanted - study.ended,
        )
        begin, limit = time.monotonic(), self._options.timeout or math.inf
        try:
            with begun:
                whole = True
                while whole and time.monotonic() - begin < limit and (batch := self._batch(study, wanted)):
                    whole = self._tried(study, batch, begun, console)
            begun.ended = "FINISHED" if whole else "KILLED"
        except UserError:
            begun.ended = "FAILED"
            raise
        finally:
            if late := begun.finish():
                console.print(f"tracking {escape(late)}", soft_wrap=True)
        return whole

    def _batch(self, study: Study, wanted: int) -> list[Trial]:
        """The trials that run next, side by side: first those that were interrupted."""
        going = study.interrupted()
        batch = going[: self._options.at_once]
        room = min(self._options.at_once - len(batch), wanted - study.ended - len(going))
        return [*batch, *(study.ask() for _ in range(room))]

    def _tried(self, study: Study, batch: Sequence[Trial], begun: Begun, console: Console) -> bool:
        """Run trials and tell the study what they came to; whether none was stopped."""
        jobs, whole = dict[int, Job](), True
        for trial in batch:
            words = [*self.space.fixed, *self.space.words(trial.params)]
            try:
                jobs[trial.number] = compose(words, config_dirs=self._dirs), words
            except UserError as error:
                study.tell(trial, [], error=str(error))
                said = f"trial {trial.number}: {' '.join(self.space.words(trial.params))}: {error}"
                console.print(f"[red]failed[/red]  {escape(said)}", soft_wrap=True)
        stands = begun.launch(jobs)
        for trial in batch:
            if (stand := stands.get(trial.number)) is None:
                continue
            place = Facts.of(jobs[trial.number][0]).parent
            facts = {"folder": str(place.relative_to(self.job.folder)), "words": self.space.words(trial.params)}
            if stand in WELL:
                study.tell(trial, self._scores(study, place), **facts)
                best = ", the best so far" if study.best and study.best.number == trial.number else ""
                said = line(study.frame.loc[trial.number], trial.number, self.metric)
                console.print(f"[green]done[/green]    {escape(said)}{best}", soft_wrap=True)
            elif stand == "failed":
                study.tell(trial, [], error=begun.error(trial.number), **facts)
            else:
                whole = False
        return whole

    def _scores(self, study: Study, place: Path) -> list[float]:
        """The metric of each seed of a trial.

        Raises:
            UserError: runs do not know it.
        """
        last = [read_json(place / f"seed-{seed}" / "summary.json")["metrics"] for seed in self.job.seeds]
        if unknown := next((metrics for metrics in last if self.metric not in metrics), None):
            study.forget()
            raise UserError(f"metric={self.metric}: these runs have none of that name; {nearest(self.metric, unknown)}")
        return [math.nan if metrics[self.metric] is None else metrics[self.metric] for metrics in last]

    def _compared(self, found: Tuned, argv: list[str], console: Console) -> Tuned:
        """Run the best and the default setting on the seeds of the report, and compare them."""
        seeds = [f"seed={self.reported.start}", f"replicas={len(self.reported)}"]
        fixed = without(self.space.fixed, "seed", "replicas")
        typed = ([*fixed, *seeds], [*fixed, *found.best, *seeds])
        jobs = [(compose(words, config_dirs=self._dirs), words) for words in typed]
        if identity(jobs[0][0]) == identity(jobs[1][0]):
            return replace(found, same=True, ended=True)
        console.print(f"report  on seeds {span(self.reported)}: the default and the best setting")
        ended, _, parents, _ = train.computed(self.words, jobs, argv, console, True, told=False)
        if ended != "FINISHED":
            return found
        names, seeds_of = [place.name for place in parents], (self.reported.start, len(self.reported))
        runs = load_runs(
            self.job.folder,
            self.job.experiment,
            methods=[self.job.method],
            slugs=names,
            seed=seeds_of[0],
            replicas=seeds_of[1],
        )
        mine = [Path(folder).parent in parents for folder in runs.frame["folder"]]  # not those of another budget
        runs = replace(runs, frame=runs.frame[mine].reset_index(drop=True), unfinished=())
        return replace(found, comparison=summarise(runs, reference=names[0], metric=self.metric), ended=True)

"""The computation of seeds side by side: journal, checkpoints between rounds, and complete folders at the end."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from typing import Any

import torch

from credit.config import schema
from credit.core.errors import RAISED, UserError
from credit.runs import checkpoint, folders, kept, policies, signals, starting
from credit.runs import job as jobs
from credit.runs.artifacts import Recorder, write_arrays
from credit.runs.journal import Journal, git_commit, settle, versions, write_atomically, write_json, write_yaml
from credit.runs.session import JobRecord, Session
from credit.trainer import Trainer

Progress = Callable[[str, int, int], None]


class Work:
    """The computation of one group of seeds.

    Args:
        config: of the job. overrides: of the job. session, number: whose job it is. found: the job's folders.
        group: the seeds.
    """

    def __init__(
        self,
        config: Mapping[str, Any],
        overrides: Sequence[str],
        session: Session,
        number: int,
        found: folders.Folders,
        group: folders.Group,
    ) -> None:
        self.config, self.session, self.number = config, session, number
        self.job, self.found, self.group = jobs.Job.of(config), found, group
        self.trainer: Trainer = schema.build(config, "trainer")
        device = jobs.device(self.job.device, number)
        self.trainer.start(group.seeds, device)
        digests = starting.given(config, self.trainer)
        self.recorder = Recorder(self.trainer)
        state = checkpoint.load(group.interrupted, device) if group.interrupted else None
        if state:
            self._go_on(state)
        else:
            starting.inherited(config, self.trainer)
        self._cpu = time.process_time() - (state["cpu_seconds"] if state else 0.0)
        self._file = found.of(group.seeds[0]) / checkpoint.NAME
        folders = [found.of(seed) if seed in group.wanted else None for seed in group.seeds]
        # before the record: whoever follows it must find no older journal
        self.journal = Journal(folders, state["journal"] if state else None)
        facts = _facts(config, overrides, found, group, self.trainer, digests)
        self.record = JobRecord(session, number, time.time(), facts)
        for seed in group.wanted:
            write_yaml(found.of(seed) / "config.yaml", {**config, "seed": seed, "replicas": 1, "rerun": False})
        self._saved, self._rounds = time.monotonic(), 0
        self._news = self.job.title
        self._policy = ""  # why it was not kept

    def compute(self, progress: Progress | None = None, heed: bool = False) -> tuple[str, str | None]:
        """Run to the end; the status, and why it failed.

        Args:
            progress: called with (title, steps done, steps in all). heed: whether signals end it between two rounds.

        Raises:
            KeyboardInterrupt: a signal said so.
        """
        trainer, status, error, stop = self.trainer, "KILLED", None, signals.Stop()

        def show(steps: int) -> None:
            if progress:
                progress(self._news, steps, trainer.total)

        try:
            if progress and not trainer.rounds:  # which learns from all that was given: it may take minutes
                progress(f"{self.job.title}, first round", 0, trainer.total)
            with signals.noted() if heed else nullcontext(stop) as stop:
                trainer.run(self._note, show, lambda: self._between(stop))
            for index, seed in enumerate(self.group.seeds):
                if seed in self.group.wanted:
                    for name, arrays in self.recorder.files(index).items():
                        write_arrays(self.found.of(seed) / name, arrays)
                    if "steps" in self.job.keep:
                        kept.write_steps(trainer, self.found.of(seed), index)
            mine = {self.group.seeds.index(seed): self.found.of(seed) for seed in self.group.wanted}
            self._policy = policies.write(trainer, self.config, mine)
            if "agent" in self.job.keep:
                kept.write_agent(trainer, self.found.of(self.group.wanted[0]))
            status = "FINISHED"
        except RAISED as failure:  # a component may raise anything; the job says so, and a sweep goes on
            status, error = "FAILED", f"{type(failure).__name__}: {failure}"
            with suppress(OSError), (self.session.folder / f"job-{self.number}.log").open("a", encoding="utf-8") as log:
                log.write(f"{self.job.method}, seeds {self.group.seeds[0]}–{self.group.seeds[-1]}\n")
                log.write(f"{traceback.format_exc()}\n")
        finally:
            status, error = self._close(status, error)
        if stop:  # it came too late for this run, but not for those behind it
            raise KeyboardInterrupt
        return status, error

    def save(self) -> None:
        """Write a checkpoint, behind a journal that is on the disk."""
        self.journal.flush(durable=True)
        content = {
            "seeds": list(self.group.seeds),
            "config_hash": jobs.identity(self.config),
            "config": dict(self.config),
            "cpu_seconds": time.process_time() - self._cpu,
            "journal": self.journal.state_dict(),
            "recorder": self.recorder.state_dict(),
            "trainer": self.trainer.state_dict(),
        }
        checkpoint.save(self._file, content)
        self._saved, self._rounds = time.monotonic(), 0

    def _go_on(self, state: Mapping[str, Any]) -> None:
        """Become what was interrupted, before anything is written."""
        try:
            self.trainer.load_state_dict(state["trainer"])
            self.recorder.load_state_dict(state["recorder"])
        except (RuntimeError, ValueError, LookupError, TypeError, AttributeError) as error:
            raise UserError(
                f"{self.group.interrupted}: the state of other code than this credit's ({error}). Go on with the "
                "credit that wrote it, or compute the run anew with rerun=true. Nothing was changed"
            ) from error

    def _between(self, stop: signals.Stop) -> None:
        self._rounds += 1
        due = self._rounds >= self.job.checkpoint_rounds
        if stop or (due and time.monotonic() - self._saved >= self.job.checkpoint_seconds):
            self.save()
        if stop:
            raise KeyboardInterrupt

    def _note(self, step: int, values: dict[str, torch.Tensor]) -> None:
        self.journal.log(step, {name: column.tolist() for name, column in values.items()})
        self.recorder.note(step)
        if "eval/success" in values:
            success = float(values["eval/success"].mean())
            self._news = f"{self.job.title}, round {self.trainer.rounds}, success {success:.2f}"

    def _close(self, status: str, error: str | None) -> tuple[str, str | None]:
        """Leave complete folders; the status that is true when that is not possible."""
        try:
            self.journal.flush()
            summary = _summary(self.config, self.record, status, self.journal.seconds, time.process_time() - self._cpu)
            summary["cpu_seconds"] /= len(self.group.seeds)
            if self._policy:
                summary["policy"] = self._policy
            for index, seed in enumerate(self.group.seeds):
                if seed not in self.group.wanted:
                    continue
                data = {name: digests[str(seed)] for name, digests in self.record.facts["data"].items()}
                own = {"seed": seed, "metrics": self.journal.last[index], "data": data}
                write_json(self.found.of(seed) / "summary.json", summary | own)
            if status == "FINISHED":  # a power cut behind DONE must find all that it stands for
                for seed in self.group.wanted:
                    settle(self.found.of(seed))
                    write_atomically(self.found.of(seed) / "DONE", summary["config_hash"] + "\n")
                    settle(self.found.of(seed))
                checkpoint.remove(self._file)
        except OSError as failure:  # the disk is full, or was taken away
            status, error = "FAILED", error or f"{type(failure).__name__}: {failure}"
        with suppress(OSError):
            self.record.finish(status, error)
        return status, error


def _facts(
    config: Mapping[str, Any],
    overrides: Sequence[str],
    found: folders.Folders,
    group: folders.Group,
    trainer: Trainer,
    given: Mapping[str, str],
) -> dict[str, Any]:
    job = jobs.Job.of(config)
    return {
        "experiment": job.experiment,
        "method": job.method,
        "title": job.title,
        "slug": found.parent.name,
        "env": config["env"]["_target_"].rpartition(".")[2],
        "seeds": list(group.wanted),
        "folders": [str(found.of(seed).relative_to(job.folder)) for seed in group.wanted],
        "config_hash": jobs.identity(config),
        "config": dict(config),
        "overrides": list(overrides),
        "rates": dict(trainer.judge.rates),
        "metric": trainer.judge.metric,
        "data": {
            name: dict(zip(map(str, group.seeds), digests, strict=True))
            for name, digests in {
                **trainer.env.digests(),
                **{name: [digest] * len(group.seeds) for name, digest in given.items()},
            }.items()
        },
    }


def _summary(
    config: Mapping[str, Any], record: JobRecord, status: str, wall_seconds: float, cpu_seconds: float
) -> dict[str, Any]:
    """What is common to the runs of a job."""
    facts = record.facts
    kept = {key: facts[key] for key in ("experiment", "method", "slug", "session", "config_hash")}
    return kept | {
        "status": status,
        "job": facts["id"],
        "started": facts["started"],
        "finished": time.time(),
        "wall_seconds": wall_seconds,
        "cpu_seconds": cpu_seconds,
        "git_commit": git_commit(),
        "versions": versions(),
        "paper": {"name": config["title"]},
    }

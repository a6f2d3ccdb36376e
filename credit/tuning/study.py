"""A study: Optuna's store in a folder of its own, which knows what is searched, and on which seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import optuna
import pandas as pd
from optuna.distributions import distribution_to_json
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial as Trial
from optuna.trial import Trial as Open
from optuna.trial import TrialState

from credit.core.errors import UserError
from credit.runs import job as jobs
from credit.runs.locks import Lock
from credit.tuning.samplers import sampler
from credit.tuning.space import Space

STORE, FACTS = "study.log", "credit"  # in the study's folder; the study's attribute that says what it is
FOLDER = "tuning"  # of all studies, in the output folder


class Study:
    """A study that is open, and locked: nobody else goes on with it meanwhile.

    Args:
        output: the output folder. name: the study's, of its folder. space: what is searched.
        config: of the default setting, on the seeds that are tuned on. metric: the judge's, or another.
        maximize: whether more of it is better. sampler: its name.

    Raises:
        UserError: another process goes on with it, the store is damaged, or it is a study of something else.
    """

    def __init__(
        self,
        output: Path,
        name: str,
        space: Space,
        config: Mapping[str, Any],
        metric: str,
        maximize: bool,
        sampler: str,
    ) -> None:
        self.folder, self.name, self.space = output / FOLDER / name, name, space
        self.metric, self.maximize = metric, maximize
        self._sampler, self._new = sampler, not (self.folder / STORE).exists()
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = Lock(self.folder / ".lock", f"study {name}")
        if not self._lock.take():
            raise UserError(
                f"{self.folder} is being gone on with by {self._lock.holder()}; wait for it, or stop it first"
            )
        try:
            self._study = self._opened()
            self._require_same(config)
        except BaseException:
            self.close()
            raise

    def _opened(self) -> optuna.Study:
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        file = self.folder / STORE
        try:
            _mend(file)
            study = optuna.create_study(
                storage=JournalStorage(JournalFileBackend(str(file))),
                study_name=self.name,
                direction="maximize" if self.maximize else "minimize",
                load_if_exists=True,
            )
            study.get_trials()
        except Exception as error:  # Optuna's own, and whatever a file that is none of its makes of it
            why = (str(error).splitlines() or [""])[0][:200]
            raise UserError(
                f"{file}: Optuna cannot open it ({type(error).__name__}: {why}); restore it, or move its folder away "
                "and begin anew: runs that are done are not run again"
            ) from None
        return study

    def _require_same(self, config: Mapping[str, Any]) -> None:
        """Write down what is searched, or find that it is what was searched before."""
        now = {
            "space": {
                key: [text, distribution_to_json(self.space.ranges[key])] for key, text in self.space.typed.items()
            },
            "seeds": [config["seed"], config["replicas"]],
            "metric": self.metric,
            "config": dict(config),
        }
        before = self._study.user_attrs.get(FACTS)
        if before is None:
            self._study.set_user_attr(FACTS, now)
            if default := self.space.values_in(config):
                self._study.enqueue_trial(default, user_attrs={"default": True})
        elif changes := _changes(before, now):
            raise UserError(
                f"{self.folder} is a study of something else: {'; '.join(changes)}. Type it as it was, or study=NAME "
                "for a new one. Nothing was changed"
            )

    def __enter__(self) -> Study:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Let others open it."""
        self._lock.release()
        if self._new:
            with suppress(OSError):
                self.folder.rmdir()  # nothing was made of it

    def forget(self) -> None:
        """Let go of a study in which nothing is known yet."""
        if self._new and not self.trials(TrialState.COMPLETE):
            (self.folder / STORE).unlink()

    def trials(self, *states: TrialState) -> list[Trial]:
        """The trials in these states, by number; all where none is given."""
        return self._study.get_trials(deepcopy=False, states=states or None)

    @property
    def ended(self) -> int:
        """How many trials have a value, or failed."""
        return len(self.trials(TrialState.COMPLETE, TrialState.FAIL))

    def interrupted(self) -> list[Trial]:
        """The trials that began and have not ended: their runs go on. One that was killed at its birth has failed."""
        found = []
        for trial in self.trials(TrialState.RUNNING):
            if {*trial.params} == {*self.space.ranges}:
                found.append(trial)
            else:
                self._study.tell(trial.number, state=TrialState.FAIL)
        return found

    def ask(self) -> Trial:
        """The next trial."""
        self._study.sampler = sampler(self._sampler, len(self.trials()))
        trial = self._study.ask(dict(self.space.ranges))
        return self.trials()[trial.number]

    def tell(self, trial: Trial, scores: Sequence[float], **facts: Any) -> float:
        """What a trial came to.

        Args:
            trial: one that was asked for. scores: the metric of each seed; their mean is its value, and one that is no
                number makes it fail. facts: what else to note.

        Returns:
            The value.
        """
        value = math.fsum(scores) / len(scores) if scores else math.nan
        noted = Open(self._study, trial._trial_id)
        for key, fact in {**facts, "scores": [*scores] if math.isfinite(value) else None}.items():
            noted.set_user_attr(key, fact)
        if math.isfinite(value):
            self._study.tell(trial.number, value)
        else:
            self._study.tell(trial.number, state=TrialState.FAIL)
        return value

    @property
    def best(self) -> Trial | None:
        """The first of the best trials; None before any has a value."""
        sign = -1 if self.maximize else 1
        return min(self.trials(TrialState.COMPLETE), key=lambda trial: sign * float(trial.value or 0), default=None)

    @property
    def frame(self) -> pd.DataFrame:
        """A row a trial, by number: its value of each key, its state, the metric, that of each seed (`scores`), …"""
        rows = [
            {
                "trial": trial.number,
                **trial.params,
                "state": trial.state.name,
                self.metric: trial.value,
                "scores": trial.user_attrs.get("scores"),
                "default": bool(trial.user_attrs.get("default")),
                "words": " ".join(self.space.words(trial.params)) if trial.params else "",
                "folder": trial.user_attrs.get("folder"),
            }
            for trial in self.trials()
            if trial.state is not TrialState.WAITING
        ]
        columns = ["trial", *self.space.ranges, "state", self.metric, "scores", "default", "words", "folder"]
        return pd.DataFrame(rows, columns=columns).set_index("trial")


def _mend(file: Path) -> None:
    """Take the last line of a store away where a power cut left a part of it: the next one would be written into it."""
    content = file.read_bytes() if file.exists() else b""
    if content and not content.endswith(b"\n") and b"\n" in content:
        file.write_bytes(content[: content.rfind(b"\n") + 1])


def _changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """`what: old → new` of all that makes a study and differs."""
    found = []
    for key in sorted(before["space"].keys() | now["space"].keys()):
        (old, was), (new, allowed) = (facts["space"].get(key, ("one value", None)) for facts in (before, now))
        if was != allowed:
            found.append(f"{key}: {old} → {new}")
    if before["seeds"] != now["seeds"]:
        old, new = (f"{first}–{first + count - 1}" for first, count in (before["seeds"], now["seeds"]))
        found.append(f"seeds: {old} → {new}")
    if before["metric"] != now["metric"]:
        found.append(f"metric: {before['metric']} → {now['metric']}")
    if jobs.identity(before["config"]) != jobs.identity(now["config"]):
        found += jobs.differences(before["config"], now["config"])
    return found

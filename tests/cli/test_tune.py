"""`credit tune` as a user types it: what it finds, what it leaves, how it goes on, what it refuses."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

import credit as package
from credit.cli.main import main
from credit.runs.load import load

ROOT = Path(package.__file__).resolve().parents[1]
WORDS = ("method=reference", "replicas=2", "trainer.steps=70", "tracking=none", "hydra/launcher=basic")
SCALES = "bonus.count.scale=tag(log,interval(.05,1))"
STUDY = "outputs/tuning/advertiser-reference/study.log"
PLACE = "outputs/advertiser/reference"


def trials(folder: Path, file: str = STUDY) -> list[FrozenTrial]:
    """As Optuna's own tools see them."""
    storage = JournalStorage(JournalFileBackend(str(folder / file)))
    (name,) = optuna.get_all_study_names(storage)
    return optuna.load_study(study_name=name, storage=storage).get_trials()


def seeds(folder: Path) -> dict[str, set[int]]:
    """Folder of a setting → the seeds that are done."""
    found: dict[str, set[int]] = {}
    for done in folder.glob(f"{PLACE}/*/seed-*/DONE"):
        found.setdefault(done.parents[1].name, set()).add(int(done.parent.name.removeprefix("seed-")))
    return found


def outcome(folder: Path, output: str = "outputs") -> list[Any]:
    found = trials(folder, STUDY.replace("outputs", output))
    return [(trial.params, trial.value, trial.user_attrs, trial.state) for trial in found]


def ran(*words: str) -> Ended:
    """A command in this process and folder."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(list(words))
    return Ended(code, out.getvalue(), err.getvalue())


@dataclass(frozen=True)
class Ended:
    code: int
    out: str
    err: str


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Ended]]:
    """The folder of a search that came to its end, and what was printed."""
    folder = tmp_path_factory.mktemp("searched")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder, ran("tune", *WORDS, SCALES, "trials=3", "report_replicas=3")


@pytest.mark.thorough
def test_a_search_tunes_on_some_seeds_and_reports_on_others(searched):
    folder, ended = searched
    assert ended.code == 0, ended.err
    found = trials(folder)
    assert [trial.state for trial in found] == [TrialState.COMPLETE] * 3
    assert found[0].params == {"bonus.count.scale": 0.35}  # the default
    best = min(found, key=lambda trial: trial.value)
    for trial in found:
        runs = [load(folder / "outputs" / trial.user_attrs["folder"] / f"seed-{seed}") for seed in (0, 1)]
        scores = [run.summary["metrics"]["regret/cumulative"] for run in runs]
        assert trial.user_attrs["scores"] == scores
        assert trial.value == pytest.approx(sum(scores) / 2)
        assert runs[0].config["bonus"]["count"]["scale"] == trial.params["bonus.count.scale"]
    places = {Path(trial.user_attrs["folder"]).name: trial.number for trial in found}
    assert "trainer.steps=70" in places
    tuned, reported = {0, 1}, {1000, 1001, 1002}
    assert {name: done & (tuned | reported) for name, done in seeds(folder).items()} == {
        name: tuned | (reported if number in (0, best.number) else set()) for name, number in places.items()
    }
    assert "trial 0 (the default): bonus.count.scale=0.35: regret/cumulative" in ended.err
    assert f"best     trial {best.number}" in ended.out
    assert "report   on seeds 1000–1002, which had no say in the choice" in ended.out


@pytest.mark.thorough
def test_the_same_command_again_runs_nothing(searched):
    _, ended = searched
    again = ran("tune", *WORDS, SCALES, "trials=3", "report_replicas=3")
    assert (again.code, again.out) == (0, ended.out)
    assert "trial" not in again.err
    assert again.err.count("all 3 seeds were done before") == 2


@pytest.mark.thorough
def test_what_it_says_to_type_next_can_be_typed(searched):
    _, ended = searched
    ran("train", "method=reference", "trainer.steps=140", "seed=1000", "replicas=3", "tracking=none")  # another budget
    said = {line.partition(" ")[0]: shlex.split(line[9:]) for line in ended.out.splitlines() if line[:1].isalpha()}
    assert said["open"][0] == "optuna-dashboard"
    assert Path(said["open"][1]).exists()
    done = ran(*said["train"][1:])
    assert (done.code, "all 3 seeds were done before" in done.err) == (0, True), done.err
    compared = ran(*said["compare"][1:], "tracking=none")
    assert compared.code == 0, compared.err
    assert "Few seeds (3)" in compared.out
    assert "trainer.steps=140" not in compared.out


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bonus.count.scale=tag(log,interval(.05,2))"], "bonus.count.scale: tag(log,interval(.05,1)) → tag(log,"),
        ([SCALES, "seed=5"], "seeds: 0–1 → 5–6"),
        ([SCALES, "feedback.noise=.5"], "feedback.noise: 0.2 → 0.5"),
    ],
)
def test_a_study_is_not_gone_on_with_as_another(searched, words, said):
    folder, _ = searched
    before = outcome(folder)
    ended = ran("tune", *WORDS, *words, "trials=9")
    assert (ended.code, said in ended.err, "study=NAME" in ended.err) == (2, True, True), ended.err
    assert outcome(folder) == before


@pytest.mark.thorough
def test_one_that_was_interrupted_goes_on_with_the_trials_it_would_have_had(credit, folder, monkeypatch):
    words = ("tune", *WORDS, SCALES, "trials=4", "report_replicas=0")
    assert credit(*words, "output=whole").code == 0
    from credit.tuning.study import Study

    tell, left = Study.tell, iter(range(2))

    def killed(*given: Any, **facts: Any) -> Any:
        if next(left, None) == 1:
            raise KeyboardInterrupt
        return tell(*given, **facts)

    monkeypatch.setattr(Study, "tell", killed)
    ended = credit(*words)
    assert (ended.code, [trial.state.name for trial in trials(folder)]) == (130, ["COMPLETE", "RUNNING"])
    monkeypatch.undo()
    os.chdir(folder)
    again = credit(*words)
    assert again.code == 0, again.err
    assert outcome(folder) == outcome(folder, "whole")
    assert len(list((folder / "outputs/sessions").iterdir())) == 1  # the session was gone on with, too


@pytest.mark.slow
def test_one_that_was_killed_in_mid_trial_goes_on(credit, folder):
    long = ("method=reference", "replicas=2", "trainer.steps=280", "tracking=none", "checkpoint_seconds=0")
    words = ("tune", *long, SCALES, "trials=3", "report_replicas=2")
    assert credit(*words, "output=whole").code == 0
    process = subprocess.Popen(
        [sys.executable, "-m", "credit.cli.main", *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=folder,
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    end = time.monotonic() + 60
    while not list(folder.glob(f"{PLACE}/bonus*/seed-*/checkpoint.pt")):  # of a trial that is not the default
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert [trial.state.name for trial in trials(folder)] == ["COMPLETE", "RUNNING"]
    resumed = credit(*words)
    assert resumed.code == 0, resumed.err
    assert outcome(folder) == outcome(folder, "whole")
    assert not list(folder.rglob("checkpoint.pt"))


@pytest.mark.thorough
def test_more_trials_side_by_side(credit, folder):
    words = ("tune", *WORDS, SCALES, "report_replicas=0", "sampler=random")
    assert credit(*words, "trials=2").code == 0
    ended = credit(*words, "trials=5", "at_once=2")
    assert ended.code == 0, ended.err
    assert [trial.state.name for trial in trials(folder)] == ["COMPLETE"] * 5
    assert "trials   5 done; tuned on seeds 0–1" in ended.out


@pytest.mark.thorough
def test_a_grid_is_tried_whole_and_the_default_may_be_the_best(credit, folder):
    ended = credit("tune", *WORDS, "mixer=reference_only", "bonus.count.scale=.35,.3501", "sampler=grid", "study=mine")
    assert ended.code == 0, ended.err
    found = trials(folder, "outputs/tuning/mine/study.log")
    assert sorted(trial.params["bonus.count.scale"] for trial in found) == [0.35, 0.3501]
    assert found[0].params == {"bonus.count.scale": 0.35}
    if found[0].value <= found[1].value:
        assert "report   none, since the default is the best" in ended.out
        assert all(max(done) < 1000 for done in seeds(folder).values())


@pytest.mark.thorough
def test_a_trial_that_fails_is_one_without_a_value(credit, folder, monkeypatch):
    from credit.agents.value_iteration import ValueIteration
    from credit.core.errors import RunError

    def fail(*_: Any) -> None:
        raise RunError("no more")

    monkeypatch.setattr(ValueIteration, "improve", fail)
    ended = credit("tune", *WORDS, SCALES, "trials=2")
    assert ended.code == 1
    assert [trial.state for trial in trials(folder)] == [TrialState.FAIL] * 2
    assert "no more" in trials(folder)[0].user_attrs["error"]
    assert "trials   2 failed; tuned on seeds 0–1" in ended.out
    assert ended.err.count("failed") == 2
    assert "Traceback" not in ended.err


def test_no_trial_begins_after_the_time(credit, folder):
    ended = credit("tune", *WORDS, SCALES, "timeout=1e-9")
    assert ended.code == 1
    assert "trials   none; tuned on seeds 0–1" in ended.out
    assert seeds(folder) == {}


@pytest.mark.thorough
def test_a_metric_that_runs_do_not_know_is_named_and_leaves_no_study(credit, folder):
    ended = credit("tune", *WORDS, SCALES, "metric=eval/auc")
    assert ended.code == 2
    assert "metric=eval/auc: these runs have none of that name; did you mean 'regret/auc'" in ended.err
    assert not (folder / STUDY).exists()


@pytest.mark.thorough
def test_another_metric_has_its_own_direction(credit, folder):
    ended = credit("tune", *WORDS, SCALES, "metric=return/label", "trials=3", "report_replicas=0")
    assert ended.code == 0, ended.err
    found = trials(folder)
    best = max(found, key=lambda trial: trial.value)
    assert f"best     trial {best.number}" in ended.out


CASES = {
    "nothing": ((), ["nothing is searched; give a key an interval or several values"]),
    "below what is allowed": (("bonus.count.scale=interval(-1,1)",), ["bonus.count.scale=-1.0", "float ≥ 0"]),
    "no such key": (("bonus.count.scael=interval(.1,1)",), ["scael: unknown key", "did you mean 'scale'?"]),
    "no such option": (("uncertainty=bootstrap,bootsrap",), ["uncertainty=bootsrap", "did you mean 'bootstrap'?"]),
    "mappings": (("mixer=choice({a:1},{b:2})",), ["{a:1} is a mapping, and no value"]),
    "methods": (("method=reference,delayed",), ["'method=reference,delayed' is not searched", "one method"]),
    "seeds": (("seed=0,1", SCALES), ["'seed=0,1' is not searched"]),
    "a problem": (("env.p_up=interval(.1,.4)",), ["env.p_up is a part of the problem or its budget"]),
    "a sweep": (("sweep=table1",), ["'sweep=table1' is a sweep of many jobs"]),
    "a metric": ((SCALES, "metric=regret/cumulativ"), ["metric=regret/cumulativ", "did you mean 'regret/cumulative'?"]),
    "a sampler": ((SCALES, "sampler=tpa"), ["sampler=tpa", "did you mean 'tpe'?"]),
    "an endless grid": ((SCALES, "sampler=grid"), ["an interval has no end of them"]),
    "the same seeds": ((SCALES, "report_seed=1", "seed=0", "replicas=2"), ["seed 1 is tuned on", "report_seed=2"]),
    "no trials": ((SCALES, "trials=0"), ["trials=0: expected a whole number, 1 or more"]),
    "no time": ((SCALES, "timeout=-3"), ["timeout=-3.0", "> 0"]),
    "a near word": ((SCALES, "trails=3"), ["unknown key 'trails'", "did you mean 'trials'?"]),
    "a study that is a path": ((SCALES, "study=a/b"), ["study='a/b'", "letters, digits"]),
    "twice": ((SCALES, "trials=3", "trials=4"), ["trials is given twice"]),
}


COMPOSES = {"below what is allowed", "no such key", "no such option", "a problem", "a metric"}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.thorough if case in COMPOSES else ()) for case in CASES]
)
def test_bad_input_makes_nothing(credit, folder, case):
    words, expected = CASES[case]
    method = () if any(word.startswith("method") for word in words) else ("method=reference",)
    ended = credit("tune", *method, *words, "tracking=none")
    assert ended.code == 2, ended.out
    for text in expected:
        assert text in ended.err
    assert "Traceback" not in ended.err
    assert list(folder.iterdir()) == []


def test_without_optuna_it_says_what_to_install(credit, monkeypatch):
    monkeypatch.setattr("credit.cli.tune.importlib.util.find_spec", lambda name: None)
    ended = credit("tune", SCALES)
    assert (ended.code, "pip install 'credit-rl[tune]'" in ended.err) == (2, True)
    assert credit("tune", "--help").out.startswith("Search for the best setting")


@pytest.mark.thorough
def test_from_python(folder: Path, capfd: pytest.CaptureFixture[str]):
    words = ["method=reference", "replicas=1", "trainer.steps=70", "tracking=none", "hydra/launcher=basic", SCALES]
    found = package.tune(words, trials=2, report_replicas=2)
    assert found.trials["state"].tolist() == ["COMPLETE"] * 2
    assert found.best == found.trials.loc[found.number, "words"].split()
    assert (found.comparison is None) == found.same
    assert repr(found).startswith("Tuned(bonus.count.scale=")
    assert capfd.readouterr().err == ""
    with pytest.raises(package.UserError, match="tune has no choice 'trails'; did you mean 'trials'"):
        package.tune(words, trails=2)
    with pytest.raises(package.UserError, match=r"tune\(trials=0\)"):
        package.tune(words, trials=0)

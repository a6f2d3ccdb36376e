"""A session that was killed at some moment, and goes on: no run twice, no row twice, none missing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from mlflow import MlflowClient
from mlflow.exceptions import MlflowException

from credit.tracking.curves import Follower
from credit.tracking.mlflow_ledger import MLflowLedger
from credit.tracking.notes import Note

from .conftest import FakeJob, FakeSession, Store


def begin(session: FakeSession, seeds: tuple[int, ...] = (0, 1), seconds: float = 0.5) -> FakeJob:
    job = session.job("delayed", seeds)
    job.header(["regret/cumulative", "time/seconds"])
    job.row(7, *([seed + 1, seconds] for seed in seeds))
    job.row(14, *([seed + 2, 2 * seconds] for seed in seeds))
    return job


def end(job: FakeJob, seconds: float = 0.5) -> None:
    job.row(21, *([seed + 3, 3 * seconds] for seed in job.seeds))
    job.end()
    job.session.end()


def identities(store: Store) -> dict[str, str]:
    return {f"{level} {name}": run.info.run_id for level in LEVELS for name, run in store.runs(level).items()}


LEVELS = ("sweep", "job", "seed")
REGRET = {"delayed/seed-0": [1.0, 2.0, 3.0], "delayed/seed-1": [2.0, 3.0, 4.0]}


def regrets(store: Store) -> dict[str, list[float]]:
    return {name: [y for _, y, _ in store.curve(run, "regret/cumulative")] for name, run in store.runs("seed").items()}


def statuses(store: Store) -> list[str]:
    return sorted(run.info.status for level in LEVELS for run in store.runs(level).values())


@pytest.mark.parametrize("memory", ["kept", "lost"])
def test_a_killed_session_goes_on_in_its_own_runs(session: FakeSession, store: Store, memory: str) -> None:
    job = begin(session)
    assert store.mirror().sync(orphaned=True).closed
    before = identities(store)
    assert statuses(store) == ["KILLED"] * 4
    if memory == "lost":
        (session.folder / "mlflow.json").unlink()
    session.go_on()
    job.go_on()
    follower = store.mirror()
    assert not follower.sync().closed
    assert statuses(store) == ["RUNNING"] * 4
    end(job)
    assert follower.sync().closed
    assert identities(store) == before
    assert statuses(store) == ["FINISHED"] * 4
    assert regrets(store) == REGRET
    tags = store.runs("seed")["delayed/seed-0"].data.tags
    assert (tags["host"], tags["pid"]) == ("box", "2"), "a person sees who went on"


def test_what_is_computed_again_keeps_its_first_times(session: FakeSession, store: Store) -> None:
    begin(session)
    store.mirror().sync(orphaned=True)
    session.go_on()
    session.jobs = 0
    again = begin(session, seconds=0.25)
    end(again, seconds=0.25)
    assert store.mirror().sync().closed
    curve = store.curve(store.runs("seed")["delayed/seed-0"], "regret/cumulative")
    assert curve == [(7, 1.0, 0.5), (14, 2.0, 1.0), (21, 3.0, 0.75)]
    assert [step for step, _, _ in store.curve(store.runs("job")["delayed/delayed"], "time/seconds")] == [7, 14, 21]


@pytest.mark.parametrize(
    "moment", [pytest.param(moment, marks=() if moment in (2, 5, 8) else pytest.mark.slow) for moment in range(1, 9)]
)
def test_the_uploader_dies_after_some_request(
    session: FakeSession, store: Store, monkeypatch: pytest.MonkeyPatch, moment: int
) -> None:
    """The store obeys the request, the process does not live to know it; nothing it would write is written."""
    requests = 0

    def cut(name: str) -> None:
        obey = getattr(MlflowClient, name)

        def request(*args: Any, **kwargs: Any) -> Any:
            nonlocal requests
            answer = obey(*args, **kwargs)
            requests += 1
            if requests == moment:
                raise KeyboardInterrupt
            return answer

        monkeypatch.setattr(MlflowClient, name, request)

    with monkeypatch.context() as dying:
        for name in ("create_run", "log_batch"):
            cut(name)
        dying.setattr(MLflowLedger, "save", lambda *args, **kwargs: None)
        job = begin(session)
        with pytest.raises(KeyboardInterrupt):
            store.mirror().sync()
    monkeypatch.undo()
    end(job)
    assert store.mirror().sync().closed
    assert regrets(store) == REGRET
    assert statuses(store) == ["FINISHED"] * 4
    assert [value for _, value, _ in store.curve(store.runs("job")["delayed/delayed"], "regret/cumulative")] == [
        1.5,
        2.5,
        3.5,
    ]


@pytest.mark.parametrize("name", ["create_run", "log_batch"])
def test_a_request_that_is_obeyed_without_an_answer(
    session: FakeSession, store: Store, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The same process tries again, as it does after a timeout."""
    obey, silent = getattr(MlflowClient, name), [True, False, True]

    def request(*args: Any, **kwargs: Any) -> Any:
        answer = obey(*args, **kwargs)
        if silent and silent.pop():
            raise MlflowException("timed out")
        return answer

    monkeypatch.setattr(MlflowClient, name, request)
    end(begin(session))
    follower = store.mirror()
    while silent:
        with pytest.raises(MlflowException, match="timed out"):
            follower.sync()
    assert follower.sync().closed
    assert regrets(store) == REGRET
    assert statuses(store) == ["FINISHED"] * 4


def test_a_twin_that_came_late_is_removed(session: FakeSession, store: Store) -> None:
    job = begin(session)
    store.mirror().sync()
    run = store.runs("seed")["delayed/seed-1"]
    store.client.create_run(run.info.experiment_id, tags=dict(run.data.tags))
    end(job)
    assert store.mirror().sync().closed
    assert store.runs("seed")["delayed/seed-1"].info.run_id == run.info.run_id
    assert regrets(store) == REGRET


@pytest.mark.parametrize("cut", ["whole", "between making the run and noting it"])
def test_another_command_goes_on_with_a_seed(session: FakeSession, store: Store, cut: str) -> None:
    """One session is killed with seeds 0 and 1; a wider sweep finishes them."""
    begin(session)
    store.mirror().sync(orphaned=True)
    before = store.runs("seed")["delayed/seed-1"]
    if cut != "whole":
        folder = session.output / "advertiser/delayed/default/seed-1"
        note = Note.read(folder)
        assert note is not None
        Note(note.uri, note.session, note.key, "").write(folder)
    wider = FakeSession(session.output, identifier="20261123-000000-0000")
    wider.jobs = 1  # so that its job starts 10 s later
    other = Store(wider, store.uri)
    follower = other.mirror()
    job = begin(wider, (0, 1, 2))
    follower.sync()
    store.mirror().sync(orphaned=True)  # the first session is looked at again, and leaves the seeds alone
    assert sorted(run.info.status for run in other.runs("seed").values()) == ["RUNNING"] * 3
    end(job)
    follower.sync()
    store.mirror().sync(orphaned=True)
    seeds = other.runs("seed")
    assert regrets(other) == REGRET | {"delayed/seed-2": [3.0, 4.0, 5.0]}
    after = seeds["delayed/seed-1"]
    assert after.info.run_id == before.info.run_id
    assert [seconds for _, _, seconds in other.curve(after, "regret/cumulative")] == [0.5, 1.0, 1.5]
    jobs = {
        run.data.tags["session"]: run
        for run in store.client.search_runs([after.info.experiment_id], "tags.level = 'job'")
    }
    assert {run.data.tags["mlflow.parentRunId"] for run in seeds.values()} == {jobs[wider.id].info.run_id}
    assert {run.info.status for run in seeds.values()} == {"FINISHED"}
    assert jobs[session.id].info.status == "KILLED"


def test_a_run_that_was_finished_and_is_computed_again_is_another(session: FakeSession, store: Store) -> None:
    end(begin(session))
    store.mirror().sync()
    before = {run.info.run_id for run in store.runs("seed").values()}
    again = FakeSession(session.output, identifier="20261123-000000-0000")
    (session.output / "advertiser/delayed/default/seed-0/summary.json").unlink()
    (session.output / "advertiser/delayed/default/seed-1/summary.json").unlink()
    end(begin(again))
    Store(again, store.uri).mirror().sync()
    experiment = store.client.get_experiment_by_name("advertiser")
    assert experiment is not None
    found = store.client.search_runs([experiment.experiment_id], "tags.level = 'seed'")
    assert len(found) == 4
    assert before < {run.info.run_id for run in found}


def test_a_store_that_lost_everything_gets_it_again(session: FakeSession, store: Store, fresh_store: Path) -> None:
    end(begin(session))
    store.mirror().sync()
    elsewhere = f"sqlite:///{shutil.copy(fresh_store, session.output / 'empty.db')}"
    for file in [session.folder / "mlflow.json", *session.output.glob("*/*/*/seed-*/mlflow.json")]:
        file.write_text(json.dumps(json.loads(file.read_text()) | {"uri": elsewhere}))
    lost = Store(session, elsewhere)
    assert lost.mirror().sync().closed
    assert regrets(lost) == REGRET
    assert statuses(lost) == ["FINISHED"] * 4


def test_a_journal_that_is_written_anew_is_read_anew(tmp_path: Path) -> None:
    """Longer than what was read of the old one, and with the same inode: only its text tells."""
    path = tmp_path / "metrics.csv"
    path.write_text("step,a\n1,0.5\n2,0.5\n")
    follower = Follower(path)
    follower.follow()
    path.write_text("step,a\n1,0.25\n2,0.25\n3,0.25\n4,0.2")
    follower.follow()
    follower.follow()
    assert [(row.step, row.values) for row in follower.rows] == [(step, {"a": 0.25}) for step in (1, 2, 3)]

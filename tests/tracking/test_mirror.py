from __future__ import annotations

import json
from math import sqrt
from pathlib import Path
from typing import Any

import pytest

from credit.tracking import Seeds, mirror
from credit.tracking.mirror import Progress

from .conftest import NAN, STARTED, FakeSession, Store


def two_jobs(session: FakeSession) -> list[Any]:
    jobs = [session.job("delayed", [0, 1, 2]), session.job("reference", [0, 1, 2])]
    for job in jobs:
        job.header(["regret/cumulative", "reward/mse", "time/seconds"])
        job.row(7, (1, 0.1, 0.5), (2, NAN, 0.5), (6, 0.3, 0.75))
        job.row(14, (2, 0.1, 1.0), (4, 0.2, 1.0), (9, 0.3, 1.0))
    return jobs


def test_a_sweep_has_jobs_and_a_job_has_seeds(session: FakeSession, store: Store) -> None:
    jobs = two_jobs(session)
    follower = store.mirror()
    assert not follower.sync().closed
    assert {run.info.status for run in store.runs("seed").values()} == {"RUNNING"}
    for job in jobs:
        job.end()
    session.end()
    assert follower.sync() == Progress(done=16, total=16, closed=True, sent=16)

    (sweep,) = store.runs("sweep").values()
    assert sweep.info.run_name == f"sweep {session.id}"
    assert (sweep.info.start_time, sweep.info.end_time) == (STARTED * 1000, (STARTED + 100) * 1000)
    methods = store.runs("job")
    assert set(methods) == {"delayed/delayed", "reference/reference"}
    job = methods["reference/reference"]
    tags = job.data.tags
    assert tags["mlflow.parentRunId"] == sweep.info.run_id
    assert (tags["environment"], tags["seeds"], tags["session"]) == ("advertiser", "0..2", session.id)
    assert (tags["config_hash"], tags["git_commit"], tags["host"]) == ("abc123", "0" * 40, "box")
    assert job.data.params == {
        "method": "reference",
        "env": "advertiser",
        "env.size": "10",
        "env.noise": "null",
        "on": "true",
    }, "registered names, and no circumstances"
    assert (job.info.start_time, job.info.end_time) == ((STARTED + 10) * 1000, (STARTED + 19) * 1000)
    assert store.files(job) == {"config.yaml"}

    seeds = store.runs("seed")
    assert len(seeds) == 6
    seed = seeds["delayed/seed-2"]
    assert seed.data.tags["mlflow.parentRunId"] == methods["delayed/delayed"].info.run_id
    assert (seed.data.tags["seed"], seed.data.params["seed"]) == ("2", "2")
    assert store.curve(seed, "regret/cumulative") == [(7, 6.0, 0.75), (14, 9.0, 1.0)]
    assert store.files(seed) == {"config.yaml", "summary.json", "recovery.npz", "recovery.svg"}
    every = [sweep, *methods.values(), *seeds.values()]
    assert {run.info.status for run in every} == {"FINISHED"}


def test_the_curves_of_a_job_are_means_with_t_intervals(session: FakeSession, store: Store) -> None:
    two_jobs(session)
    store.mirror().sync()
    job = store.runs("job")["delayed/delayed"]
    assert store.curve(job, "regret/cumulative") == [(7, 3.0, 0.75), (14, 5.0, 1.0)]
    # t(.975, 2) = 4.302653; the sample variances of (1, 2, 6) and (2, 4, 9) are 7 and 13.
    for end, sign in (("low", -1), ("high", 1)):
        values = [value for _, value, _ in store.curve(job, f"interval/regret_cumulative_{end}")]
        expected = [3 + sign * 4.3026527 * sqrt(7 / 3), 5 + sign * 4.3026527 * sqrt(13 / 3)]
        assert values == pytest.approx(expected, rel=1e-6)
    assert [step for step, _, _ in store.curve(job, "reward/mse")] == [14], "one seed does not know it at 7"


def test_one_seed_has_no_interval(session: FakeSession, store: Store) -> None:
    job = session.job("delayed", [4])
    job.header(["regret/cumulative"])
    job.row(7, (3,))
    store.mirror().sync()
    (run,) = store.runs("job").values()
    assert set(run.data.metrics) == {"regret/cumulative"}
    assert run.data.tags["seeds"] == "4"


def test_a_single_job_is_on_top(tmp_path: Path, uri: str) -> None:
    session = FakeSession(tmp_path / "other", kind="job")
    store = Store(session, uri)
    two_jobs(session)
    store.mirror().sync()
    assert not store.runs("sweep")
    assert all("mlflow.parentRunId" not in run.data.tags for run in store.runs("job").values())


@pytest.mark.parametrize("memory", ["kept", "lost"])
def test_a_mirror_continues_where_another_was_killed(session: FakeSession, store: Store, memory: str) -> None:
    first, second = two_jobs(session)
    store.mirror().sync()
    if memory == "lost":
        (session.folder / "mlflow.json").unlink()
    first.row(21, (3, 0.1, 2.0), (6, 0.2, 2.0), (9, 0.3, 2.0))
    first.end()
    second.end()
    session.end()
    assert store.mirror().sync().closed
    assert len(store.runs("sweep")) == 1
    assert len(store.runs("job")) == 2
    assert len(store.runs("seed")) == 6
    assert store.curve(store.runs("seed")["delayed/seed-0"], "regret/cumulative") == [
        (7, 1.0, 0.5),
        (14, 2.0, 1.0),
        (21, 3.0, 2.0),
    ]
    assert [value for _, value, _ in store.curve(store.runs("job")["delayed/delayed"], "regret/cumulative")] == [
        3.0,
        5.0,
        6.0,
    ]


def test_half_a_line_waits_for_its_end(session: FakeSession, store: Store) -> None:
    job = session.job("delayed", [0])
    job.header(["regret/cumulative"])
    follower = store.mirror()
    with (job.folders[0] / "metrics.csv").open("a") as file:
        file.write("7,1.5\n14,2")
        file.flush()
        follower.sync()
        file.write("5\n")
    job.end()
    session.end()
    follower.sync()
    (run,) = store.runs("seed").values()
    assert [value for _, value, _ in store.curve(run, "regret/cumulative")] == [1.5, 25.0]


def test_a_failed_job_is_shown_with_its_error(session: FakeSession, store: Store) -> None:
    good, bad = two_jobs(session)
    good.end()
    bad.row(21, (3, 0.1, 2.0), (6, NAN, 2.0), (9, 0.3, 2.0))
    bad.end("FAILED", "window 3: the label is NaN")
    session.end("FAILED")
    assert store.mirror().sync().closed
    jobs = store.runs("job")
    assert jobs["delayed/delayed"].info.status == "FINISHED"
    assert jobs["reference/reference"].info.status == "FAILED"
    said = jobs["reference/reference"].data.tags["mlflow.note.content"]
    assert said.endswith("**Failed:**\n\n```\nwindow 3: the label is NaN\n```")
    seeds = {name: run.info.status for name, run in store.runs("seed").items()}
    assert seeds["reference/seed-1"] == "FAILED"
    assert seeds["delayed/seed-1"] == "FINISHED"
    assert next(iter(store.runs("sweep").values())).info.status == "FAILED"


def test_what_an_orphan_leaves_was_killed(session: FakeSession, store: Store) -> None:
    first, _ = two_jobs(session)
    first.end()
    assert store.mirror().sync(orphaned=True).closed
    jobs = store.runs("job")
    assert jobs["delayed/delayed"].info.status == "FINISHED"
    killed = jobs["reference/reference"].info
    assert (killed.status, killed.end_time) == ("KILLED", (STARTED + 11) * 1000), "its last row is its end"


@pytest.mark.parametrize(("seeds", "runs"), [("none", 0), ("auto", 2), ("all", 3)])
def test_which_seeds_get_a_run(
    session: FakeSession, store: Store, monkeypatch: pytest.MonkeyPatch, seeds: Seeds, runs: int
) -> None:
    assert mirror.AUTO_SEEDS == 20
    monkeypatch.setattr(mirror, "AUTO_SEEDS", 2)
    job = session.job("delayed", range(3))
    job.header(["regret/cumulative"])
    job.row(7, (0,), (1,), (5,))
    store.mirror(seeds).sync()
    assert set(store.runs("seed")) == {f"delayed/seed-{seed}" for seed in range(runs)}
    assert store.curve(store.runs("job")["delayed/delayed"], "regret/cumulative")[0][1] == 2.0


def test_a_deleted_run_does_not_stop_the_others(session: FakeSession, store: Store) -> None:
    first, second = two_jobs(session)
    follower = store.mirror()
    follower.sync()
    store.client.delete_run(store.runs("job")["delayed/delayed"].info.run_id)
    for job in (first, second):
        job.row(21, (3, 0.1, 2.0), (6, 0.2, 2.0), (9, 0.3, 2.0))
        job.end()
    session.end()
    progress = follower.sync()
    assert progress.closed
    assert len(progress.problems) == 1
    assert progress.problems[0].startswith("delayed: ")
    assert store.runs("job")["reference/reference"].info.status == "FINISHED"


def test_a_stale_summary_says_nothing(session: FakeSession, store: Store) -> None:
    job = session.job("delayed", [0])
    job.header(["regret/cumulative"])
    old = {"session": "an earlier one", "status": "FAILED", "finished": 1.0}
    (job.folders[0] / "summary.json").write_text(json.dumps(old))
    store.mirror().sync()
    assert store.runs("seed")["delayed/seed-0"].info.status == "RUNNING"

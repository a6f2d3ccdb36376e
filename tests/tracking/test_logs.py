"""Trackers whose runs are logs: every row of the journal is there, once, whatever was killed in between."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from credit.tracking.mirror import Mirror
from credit.tracking.sessions import State, pending, store_of
from credit.tracking.tensorboard import TensorBoardTracking
from credit.tracking.wandb import WandbTracking, _records

from .conftest import FakeSession

Points = list[tuple[int, float]]


class Log:
    """A store of one kind, read back."""

    def __init__(self, session: FakeSession, tracking: Any) -> None:
        self.session, self.uri = session, tracking.address(session.output)
        State(self.uri, "auto").write(session.folder)

    def mirror(self) -> Mirror:
        return Mirror(self.session.output, self.session.folder, self.uri)

    def points(self) -> dict[str, Points]:
        """Name of a run → (step, regret) of every row, in the order of the log."""
        raise NotImplementedError


class TensorBoard(Log):
    def points(self) -> dict[str, Points]:
        from tensorboard.backend.event_processing.event_file_loader import LegacyEventFileLoader

        found: dict[str, Points] = {}
        for file in sorted((self.session.output / "tensorboard").rglob("events.*")):
            rows = found.setdefault(file.parent.name, [])
            for event in LegacyEventFileLoader(str(file)).Load():
                values = [value.simple_value for value in event.summary.value if value.tag == "regret/cumulative"]
                rows += [(event.step, value) for value in values]
        return found


class Wandb(Log):
    def points(self) -> dict[str, Points]:
        from wandb.proto.wandb_internal_pb2 import Record

        found: dict[str, Points] = {}
        for file in sorted((self.session.output / "wandb").glob("offline-run-*/*.wandb")):
            name = ""
            for record in map(Record.FromString, _records(file.read_bytes())):
                if record.HasField("run"):
                    name = record.run.display_name
                if record.HasField("history"):
                    cells = {"/".join([item.key, *item.nested_key]).strip("/"): item for item in record.history.item}
                    value = float(cells["regret/cumulative"].value_json)
                    found.setdefault(name, []).append((record.history.step.num, value))
        return found


@pytest.fixture(params=["tensorboard", pytest.param("wandb", marks=pytest.mark.thorough)])
def log(request: pytest.FixtureRequest, session: FakeSession) -> Log:
    pytest.importorskip(request.param)
    kinds: dict[str, Any] = {"tensorboard": (TensorBoard, TensorBoardTracking), "wandb": (Wandb, WandbTracking)}
    kind, tracking = kinds[request.param]
    return kind(session, tracking())


def begun(session: FakeSession) -> Any:
    job = session.job("delayed", [0, 1])
    job.header(["regret/cumulative", "time/seconds"])
    job.row(7, (1, 0.5), (3, 0.5))
    job.row(14, (2, 1.0), (4, 1.0))
    return job


def seeds(points: dict[str, Points]) -> list[Points]:
    return [rows for name, rows in sorted(points.items()) if "seed" in name]


def test_jobs_and_seeds_have_every_row(session: FakeSession, log: Log) -> None:
    job = begun(session)
    mirror = log.mirror()
    assert not mirror.sync().closed
    job.row(21, (5, 2.0), (7, 2.0))
    job.end()
    session.end()
    progress = mirror.sync()
    assert (progress.done, progress.total, progress.closed) == (9, 9, True)
    points = log.points()
    assert seeds(points) == [[(7, 1), (14, 2), (21, 5)], [(7, 3), (14, 4), (21, 7)]]
    (mean,) = (rows for name, rows in points.items() if "seed" not in name)
    assert mean == [(7, 2), (14, 3), (21, 6)]
    assert not list(pending(session.output))


@pytest.mark.parametrize("memory", ["kept", "lost"])
def test_a_mirror_continues_where_another_was_killed(session: FakeSession, log: Log, memory: str) -> None:
    job = begun(session)
    killed = log.mirror()
    killed.sync()
    for ledger in [killed._ledger]:
        for opened in getattr(ledger, "_runs", {}).values():
            opened.finish(exit_code=1)  # what a process that ends does for its runs
    if memory == "lost":
        for file in [*session.folder.glob("[tw]*.json"), *session.output.glob("*/*/*/seed-*/[tw]*.json")]:
            file.unlink()
    job.row(21, (5, 2.0), (7, 2.0))
    job.end()
    session.end()
    assert log.mirror().sync().closed
    assert seeds(log.points()) == [[(7, 1), (14, 2), (21, 5)], [(7, 3), (14, 4), (21, 7)]]


def test_another_session_goes_on_with_a_run(session: FakeSession, log: Log) -> None:
    begun(session)
    session.end("KILLED")
    log.mirror().sync(orphaned=True)
    later = FakeSession(session.output, identifier="20261123-000000-aaaa")
    job = later.job("delayed", [0, 1])
    job.row(21, (5, 2.0), (7, 2.0))
    job.end()
    later.end()
    log.session = later
    assert log.mirror().sync().closed
    points = log.points()
    assert seeds(points) == [[(7, 1), (14, 2), (21, 5)], [(7, 3), (14, 4), (21, 7)]]
    assert sum("seed" in name for name in points) == 2, "they are the same runs"


def test_what_was_cut_short_is_cut_off(session: FakeSession) -> None:
    pytest.importorskip("tensorboard")
    log = TensorBoard(session, TensorBoardTracking())
    job = begun(session)
    log.mirror().sync()
    for file in (session.output / "tensorboard").rglob("events.*"):
        file.write_bytes(file.read_bytes()[:-9])  # in the middle of the last row
    job.end()
    session.end()
    assert log.mirror().sync().closed
    assert seeds(log.points()) == [[(7, 1), (14, 2)], [(7, 3), (14, 4)]]


def test_a_folder_that_moves_takes_its_store_with_it(session: FakeSession, tmp_path: Path) -> None:
    for tracking in (TensorBoardTracking(), WandbTracking(project="it's & more")):
        uri = tracking.address(session.output)
        State(uri, "auto").write(session.folder)
        assert store_of(session.folder, session.output) == (uri, "auto")
    moved = session.output.rename(tmp_path / "to #here?")
    found = store_of(moved / "sessions" / session.id, moved)
    assert found == (WandbTracking(project="it's & more").address(moved), "auto")

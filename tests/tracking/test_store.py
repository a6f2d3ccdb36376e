"""Where a store lies: paths with any letter in them, folders that move, and what the environment says."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import pytest
from mlflow import MlflowClient

from credit.cli.sync import sync
from credit.tracking import MLflowTracking
from credit.tracking.describe import sweep_card
from credit.tracking.mirror import Mirror
from credit.tracking.sessions import State, lacking, pending, store_of
from credit.tracking.store import born, client_of, follow, open_experiment, resolve_uri, sqlite_file, uri_problem
from credit.tracking.uploader import catch_up

from .conftest import FakeSession

ODD = ["q?x", "a%20b", "c,d", "br[1]", "eq=1", "h#x", "semi;x", "am&p", "grüße", "it's", "d${x}", "a b", "at@x:y"]


@pytest.mark.parametrize("name", ODD)
def test_an_address_names_the_file_whatever_its_folder_is_called(tmp_path: Path, name: str) -> None:
    uri = resolve_uri(None, tmp_path / name)
    assert sqlite_file(uri) == tmp_path / name / "mlflow.db"
    assert resolve_uri(uri, tmp_path) == uri
    assert uri_problem(uri) is None


def test_an_odd_folder_holds_its_store_and_nothing_lies_beside_it(tmp_path: Path, fresh_store: Path) -> None:
    output = tmp_path / "q?x#a%20b;ü" / "outputs"
    output.mkdir(parents=True)
    (output / "mlflow.db").write_bytes(fresh_store.read_bytes())
    session = FakeSession(output)
    job = session.job("delayed", [0])
    job.header(["regret/cumulative", "time/seconds"])
    job.row(7, [1.0, 0.5])
    job.end()
    session.end()
    uri = resolve_uri(None, output)
    assert Mirror(output, session.folder, uri).sync().closed
    assert [path.name for path in tmp_path.iterdir()] == [output.parent.name]
    assert {path.name for path in output.glob("artifacts/*/*/*")} >= {"config.yaml", "summary.json"}


def test_artifacts_follow_a_folder_that_moved(tmp_path: Path, fresh_store: Path) -> None:
    before, after = tmp_path / "A", tmp_path / "B"
    before.mkdir()
    (before / "mlflow.db").write_bytes(fresh_store.read_bytes())
    client, experiment = open_experiment(resolve_uri(None, before), before, "mine")
    run = client.create_run(experiment).info.run_id
    client.log_text(run, "one", "one.txt")
    before.rename(after)
    client, again = open_experiment(resolve_uri(None, after), after, "mine")
    assert again == experiment
    for number in (run, client.create_run(experiment).info.run_id):  # MLflow's client keeps where it wrote before
        assert client.get_run(number).info.artifact_uri == f"{after.as_uri()}/artifacts/{number}/artifacts"
    assert (after / "artifacts" / run / "artifacts" / "one.txt").exists()
    assert not before.exists()


def test_a_store_elsewhere_is_left_as_it_is(tmp_path: Path, fresh_store: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(fresh_store.read_bytes())
    with sqlite3.connect(tmp_path / "mlflow.db") as store:
        store.execute("UPDATE experiments SET artifact_location = 's3://bucket/artifacts' WHERE name = 'fresh'")
    follow(tmp_path)
    found = MlflowClient(resolve_uri(None, tmp_path)).get_experiment_by_name("fresh")
    assert found is not None
    assert found.artifact_location == "s3://bucket/artifacts"


def test_a_session_that_moved_is_looked_for_where_it_is(tmp_path: Path) -> None:
    session = FakeSession(tmp_path / "A")
    session.end()
    State(resolve_uri(None, session.output), "auto").write(session.folder)
    session.output.rename(tmp_path / "B")
    (moved,) = pending(tmp_path / "B")
    assert store_of(moved, tmp_path / "B") == (resolve_uri(None, tmp_path / "B"), "auto")


def test_a_store_of_a_name_of_its_own_that_is_gone_is_not_made_anew(
    tmp_path: Path, session: FakeSession, capsys: pytest.CaptureFixture[str]
) -> None:
    named = f"sqlite:///{tmp_path / 'gone' / 'mine.db'}"
    session._session["tracking"]["uri"] = named
    session.end()
    assert sync(session.output) == 1
    assert f"its store {named} is gone; move its folder back" in capsys.readouterr().err
    catch_up(session.output)
    assert not (tmp_path / "gone").exists()


def test_what_mlflow_refused_is_still_lacking(
    session: FakeSession, fresh_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("credit.tracking.mlflow_ledger.metric_name", str)  # a name that MLflow does not take
    (session.output / "mlflow.db").write_bytes(fresh_store.read_bytes())
    job = session.job("delayed", [0])
    job.header(["weight//a", "time/seconds"])
    job.row(7, [1.0, 0.5])
    job.end()
    session.end()
    uri = resolve_uri(None, session.output)
    progress = Mirror(session.output, session.folder, uri).sync()
    assert progress.closed
    assert progress.problems
    assert [*pending(session.output)] == []
    assert [*lacking(session.output)] == [session.folder]
    client = client_of(uri)
    experiment = client.get_experiment_by_name("advertiser")
    assert experiment is not None
    refused = client.search_runs([experiment.experiment_id], "tags.level = 'job'")[0]
    assert refused.info.status == "FAILED"
    assert "MLflow did not take everything of this run" in refused.data.tags["mlflow.note.content"]
    monkeypatch.undo()
    assert not Mirror(session.output, session.folder, uri).sync().problems
    refused = client.get_run(refused.info.run_id)
    assert refused.info.status == "FINISHED"
    assert "Failed" not in refused.data.tags["mlflow.note.content"]
    assert [*lacking(session.output)] == []


@pytest.mark.parametrize("what", ["removed", "damaged", "made anew"])
def test_a_store_that_is_another_one_now_lacks_everything(what: str, session: FakeSession, fresh_store: Path) -> None:
    """Whatever a session remembers of the one that was there."""
    store, uri = session.output / "mlflow.db", resolve_uri(None, session.output)
    store.write_bytes(fresh_store.read_bytes())
    job = session.job("delayed", [0])
    job.header(["time/seconds"])
    job.row(7, [0.5])
    job.end()
    session.end()
    assert Mirror(session.output, session.folder, uri).sync().closed
    assert [*pending(session.output)] == []
    if what == "removed":
        store.unlink()
    elif what == "damaged":
        store.write_bytes(b"no database " * 400)
    else:
        before = born(uri) - 60
        os.utime(session.folder / "mlflow.json", (before, before))
    assert [*pending(session.output)] == [session.folder]


def test_the_environment_names_a_store(session: FakeSession, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "nowhere")
    (problem,) = MLflowTracking().check(session.output)
    assert "'nowhere' (by the environment's MLFLOW_TRACKING_URI) is not a tracking URI" in problem
    assert MLflowTracking("sqlite:///typed.db").uri == "sqlite:///typed.db"
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    assert MLflowTracking().uri is None


def test_a_session_knows_the_store_that_its_environment_named(session: FakeSession) -> None:
    named = f"sqlite:///{session.output / 'e.db'}"
    State(named, "all").write(session.folder)
    assert store_of(session.folder, session.output) == (named, "all")


@pytest.mark.parametrize("error", [KeyError, OSError])
def test_a_number_without_a_name_is_a_user(
    session: FakeSession, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    def nobody() -> str:
        raise error("getpwuid(): uid not found: 54321")

    monkeypatch.setattr("getpass.getuser", nobody)
    card = sweep_card(session._session)
    assert card.tags["mlflow.user"] == str(os.getuid())

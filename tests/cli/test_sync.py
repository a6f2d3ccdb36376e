"""`credit sync` as a user types it; the outages it is for are in tests/tracking/test_outages.py."""

from __future__ import annotations

import json

import pytest

SHORT = ("method=random", "replicas=1", "trainer.steps=140", "trainer.log_every=10")


def test_without_sessions_it_says_what_to_give(credit, folder):
    ended = credit("sync")
    assert ended.code == 2
    assert f"{folder / 'outputs'} is no output folder with sessions" in ended.err
    assert not (folder / "outputs").exists()


@pytest.mark.parametrize("words", [("one", "two"), ("--all",)])
def test_words_that_it_does_not_know(credit, words):
    ended = credit("sync", *words)
    assert ended.code == 2
    assert "takes one folder" in ended.err


def test_help(credit):
    ended = credit("sync", "--help")
    assert ended.code == 0
    assert "Usage: credit sync [DIR]" in ended.out


def test_sessions_without_tracking_have_nothing_to_upload(credit, folder):
    assert credit("train", *SHORT, "tracking=none").code == 0
    assert credit("sync").out.startswith("nothing to upload")
    (session,) = (folder / "outputs/sessions").iterdir()
    assert "tracking=none" in credit("sync", str(session)).out


def test_a_session_that_runs_is_left_alone(credit, folder):
    from credit.runs.session import Session

    session = Session.begin(folder / "outputs", "job", "x", [], {"uri": None, "seeds": "auto"}, [{"seed": 0}])
    ended = credit("sync")
    assert (ended.code, ended.err) == (0, "")
    assert f"{session.id}: runs now" in ended.out
    session.finish("KILLED")


@pytest.mark.thorough
def test_a_damaged_store_is_one_message(credit, folder):
    assert credit("train", *SHORT).code == 0
    for path in (folder / "outputs").glob("mlflow.db*"):
        path.write_bytes(b"no database " * 400)
    (session,) = (folder / "outputs/sessions").iterdir()
    (session / "mlflow.json").unlink(missing_ok=True)  # a slow machine may not have come to it
    ended = credit("sync", str(session))
    assert ended.code == 1
    assert ended.err.startswith("credit sync: ")
    assert "file is not a database" in ended.err
    assert len(ended.err.splitlines()) == 2


@pytest.mark.slow
def test_the_command_line_from_an_outage_to_the_store(credit, folder):
    ended = credit("train", *SHORT, "tracking.uri=http://127.0.0.1:9")
    assert ended.code == 0, "no run fails because of a store"
    assert "tracking MLflow: not everything was uploaded" in ended.out
    assert ended.out.count("credit sync") == 1
    assert credit("sync").code == 1
    (session,) = (folder / "outputs/sessions").iterdir()
    path = session / "tracking.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"uri": f"sqlite:///{folder / 'other.db'}"}))
    ended = credit("sync")
    assert (ended.code, ended.err) == (0, "")
    (journal,) = folder.glob("outputs/advertiser/random/*/seed-0/metrics.csv")
    rows = 2 * (len(journal.read_text().splitlines()) - 1)  # the seed's and the job's
    assert f"{session.name}: {rows} rows in sqlite:///{folder / 'other.db'}, {rows} of them new" in ended.out
    assert credit("sync").out.startswith("nothing to upload")

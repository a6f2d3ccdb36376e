"""Where a report is logged, and that it costs nobody anything where that fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from credit.tracking.report_run import log_beside_runs
from credit.tracking.store import dashboard

Calls = list[tuple[Any, ...]]


def session(output: Path, started: float, tracking: object) -> Path:
    file = output / "sessions" / f"session-{started:g}" / "session.json"
    file.parent.mkdir(parents=True)
    node = {"experiment": "advertiser", "started": started, "tracking": tracking}
    file.write_text(json.dumps(node), encoding="utf-8")
    return file


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    found: Calls = []
    monkeypatch.setattr("credit.tracking.report_run.log_report", lambda *args: found.append(args))
    return found


def test_the_newest_session_decides_where_to_log(tmp_path: Path, calls: Calls) -> None:
    session(tmp_path, 1.0, {"uri": "old"})
    session(tmp_path, 2.0, {"uri": "sqlite:///new.db"})
    given = ("advertiser", tmp_path / "reports", {"reference/regret/cumulative/mean": 91.5})
    assert log_beside_runs(tmp_path, *given).startswith("Logged to MLflow")
    assert calls == [(tmp_path, "sqlite:///new.db", *given)]
    for started, untracked in ((3.0, None), (4.0, {"_target_": "credit.tracking.NoTracking"})):
        session(tmp_path, started, untracked)
        assert "was not tracked" in log_beside_runs(tmp_path, *given)
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("output", "uri", "command"),
    [
        ("outputs", None, "credit dashboard"),
        ("my runs", None, "credit dashboard 'output=my runs'"),
        ("outputs", "http://host:5000", "credit dashboard uri=http://host:5000"),
        ("outputs", "postgresql://me:secret@host/db", "credit dashboard uri=…"),
    ],
)
def test_a_store_is_opened_by_the_command_that_is_advised(output: str, uri: str | None, command: str) -> None:
    assert dashboard(Path(output), uri).replace("'uri=…'", "uri=…") == command


def test_the_advice_names_the_output(tmp_path: Path, calls: Calls) -> None:
    session(tmp_path, 1.0, {"uri": None})
    said = log_beside_runs(tmp_path, "advertiser", tmp_path / "reports", {})
    assert f"`credit dashboard output={tmp_path}`" in said
    assert len(calls) == 1


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"experiment": "advertiser", "started": null, "tracking": null}'])
def test_a_damaged_session_costs_nothing(tmp_path: Path, calls: Calls, content: str) -> None:
    session(tmp_path, 1.0, None).write_text(content, encoding="utf-8")
    assert "was not tracked" in log_beside_runs(tmp_path, "advertiser", tmp_path, {})
    assert calls == []


def test_a_store_that_fails_costs_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_args: object) -> None:
        raise ConnectionError("refused\nand much more")

    monkeypatch.setattr("credit.tracking.report_run.log_report", fail)
    session(tmp_path, 1.0, {"uri": None})
    said = log_beside_runs(tmp_path, "advertiser", tmp_path, {})
    assert said == "Not logged to MLflow: ConnectionError: refused"

from __future__ import annotations

import json
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mlflow import MlflowClient

from credit.cli import dashboard
from credit.core.errors import UserError
from credit.tracking import landing, server
from credit.tracking.mirror import Mirror

from .conftest import FakeSession


def opened(uri: str) -> dict[str, Any]:
    """What the page puts into the browser."""
    text = landing.landing_page(MlflowClient(uri)).split("} = ", 1)[1].split(";\n", 1)[0]
    content: dict[str, Any] = json.loads(text)
    return content


def mirrored(session: FakeSession, uri: str) -> dict[str, str]:
    """Two jobs in the store; the id of every run by its name."""
    for method in ("delayed", "reference"):
        job = session.job(method, [0, 1])
        job.header(["regret/cumulative", "reward/mse"])
        job.row(7, (1, 2), (3, 4))
    Mirror(session.output, session.folder, uri).sync()
    client = MlflowClient(uri)
    runs = client.search_runs([experiment.experiment_id for experiment in client.search_experiments()])
    return {run.info.run_name: run.info.run_id for run in runs}


def test_the_newest_sweep_opens_on_its_methods(session: FakeSession, uri: str) -> None:
    runs = mirrored(session, uri)
    page = opened(uri)
    sweep = runs[f"sweep {session.id}"]
    assert page["address"].startswith("/?ui#/experiments/2/runs?compareRunsMode=CHART&searchFilter=&")
    assert page["view"]["expanded"] == {sweep: True}
    assert page["view"]["visible"] == {sweep: False}, "it has no curves of its own"
    charts = [chart["selectedMetricKeys"] for chart in page["view"]["first"]["compareRunCharts"]]
    band = ["interval/regret_cumulative_high", "interval/regret_cumulative_low"]
    assert charts == [["regret/cumulative"], ["regret/cumulative", *band], ["reward/mse"]]
    folded = [part["name"] for part in page["view"]["first"]["compareRunSections"] if not part["display"]]
    assert folded == ["interval", "report"]


def _run(session: str, metrics: set[str]) -> Any:
    """As MLflow gives a job of a session."""
    data = SimpleNamespace(tags={"session": session}, metrics=dict.fromkeys(metrics, 0.0), params={})
    return SimpleNamespace(data=data, info=SimpleNamespace(run_name="delayed"))


def labelled(session: FakeSession, uri: str) -> dict[str, Any]:
    """What the page says of a sweep whose jobs differ in a parameter."""
    told = [{"env.size": 10}, {"env.size": 20}]
    session._session |= {"labels": told}
    session.go_on()
    for number, label in enumerate(told):
        job = session.job(f"m{number}", [0])
        job.content["config"]["env"]["size"] = label["env.size"]
        job.content["metric"] = "reward/mse"
        job.go_on()
        job.header(["regret/cumulative", "reward/mse"])
        job.row(7, (1, 2))
    Mirror(session.output, session.folder, uri).sync()
    view: dict[str, Any] = opened(uri)["view"]
    return view


def test_the_table_shows_the_main_metric_and_then_what_differs(session: FakeSession, uri: str) -> None:
    view = labelled(session, uri)
    columns = ["metrics.`reward/mse`", "params.`env.size`", "metrics.`regret/cumulative`"]
    assert view["sweep"]["selectedColumns"] == columns
    assert view["sweep"]["columnOrder"][2:] == columns
    assert view["session"] == session.id
    parallel = [chart for chart in view["first"]["compareRunCharts"] if chart["type"] == "PARALLEL"]
    assert [(chart["selectedParams"], chart["selectedMetrics"]) for chart in parallel] == [
        (["env.size"], ["reward/mse"])
    ]


def test_a_sweep_is_called_by_what_was_varied(session: FakeSession, uri: str) -> None:
    labelled(session, uri)
    (sweep,) = MlflowClient(uri).search_runs(["2"], "tags.level = 'sweep'")
    assert sweep.info.run_name == "sweep of size"
    assert sweep.data.tags["session"] == session.id


def test_columns_are_those_of_the_newest_sweep() -> None:
    view = landing._view(None, [], [_run("new", {"regret/cumulative"}), _run("old", {"reward/mse"})])
    assert view["sweep"]["selectedColumns"] == ["metrics.`regret/cumulative`"]


def test_intervals_of_many_are_left_to_their_section() -> None:
    band = {"interval/regret_cumulative_low", "interval/regret_cumulative_high"}
    for jobs, charts in ((landing.MANY, 2), (landing.MANY + 1, 1)):
        view = landing._view(None, [], [_run("new", {"regret/cumulative", *band})] * jobs)
        assert len(view["first"]["compareRunCharts"]) == charts


def test_runs_are_called_by_what_differs_in_colours_of_their_own(session: FakeSession, uri: str) -> None:
    labelled(session, uri)
    client = MlflowClient(uri)
    jobs = client.search_runs(["2"], "tags.level = 'job'")
    assert sorted(str(run.info.run_name) for run in jobs) == ["size=10", "size=20"]
    assert len({run.data.tags["mlflow.runColor"] for run in jobs}) == 2
    assert "| `env.size` | 10 |" in jobs[-1].data.tags["mlflow.note.content"]


def test_many_seeds_do_not_hide_a_method(session: FakeSession, uri: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landing, "PAGE", 3)
    mirrored(session, uri)
    assert "searchFilter=tags.level%3D%22job%22%20and" in opened(uri)["address"]
    assert opened(uri)["view"]["expanded"] == {}


def test_an_empty_store_opens_on_its_experiments(uri: str) -> None:
    assert opened(uri)["address"] == "/?ui#/experiments"


def test_without_a_store_it_says_what_to_run(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="credit train"):
        dashboard.main([f"output={tmp_path}"])
    assert not list(tmp_path.iterdir())


def test_a_port_that_is_taken(tmp_path: Path, uri: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"port={port}"):
            dashboard.main([f"output={tmp_path}", f"uri={uri}", f"port={port}"])


def test_an_address_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="uri='nonsense'"):
        dashboard.main([f"output={tmp_path}", "uri=nonsense"])


@pytest.mark.parametrize(
    ("path", "query", "host", "ours"),
    [
        ("/", b"", b"127.0.0.1:5000", True),
        ("/", b"ui", b"127.0.0.1:5000", False),
        ("/static", b"", b"localhost", False),
        ("/", b"", b"elsewhere.example", False),
    ],
)
def test_only_the_root_is_ours(path: str, query: bytes, host: bytes, ours: bool) -> None:
    import anyio

    answered: list[str] = []

    async def mlflow_itself(scope: Any, receive: Any, send: Any) -> None:
        answered.append("mlflow")

    async def send(message: Any) -> None:
        answered.append(message["type"])

    async def receive() -> None:
        return None

    scope = {"type": "http", "path": path, "query_string": query, "headers": [(b"host", host)]}
    anyio.run(server.opening_on(mlflow_itself, lambda: "page"), scope, receive, send)
    assert answered == (["http.response.start", "http.response.body"] if ours else ["mlflow"])


def test_a_store_that_is_damaged_is_one_message(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(b"no database " * 400)
    with pytest.raises(UserError, match=r"mlflow\.db cannot be read \(file is not a database\).*credit sync"):
        dashboard.main([f"output={tmp_path}"])

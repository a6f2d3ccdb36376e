"""Many processes on one store."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.bench.reliability_tracking import fresh_stores, upload_together, workshop, writers
from credit.bench.servers import Server, postgresql, postgresql_programs

from .reading import all_runs, assert_equal_to_journals


@pytest.mark.slow
def test_eight_processes_on_a_fresh_sqlite_store(tmp_path: Path) -> None:
    with writers() as processes:
        row = fresh_stores(tmp_path, processes, trials=3)
        assert row.met, row.figure
        output = tmp_path / "again"
        uri = f"sqlite:///{output / 'mlflow.db'}"
        assert [problem for *_, problem in upload_together(processes, output, uri, 3, 10, 4)] == [""] * 8
    assert assert_equal_to_journals(uri, output) == 8 * 3 * 10


@pytest.mark.slow
def test_eight_writers_on_postgresql() -> None:
    if postgresql_programs() is None:
        pytest.skip("PostgreSQL is not installed: apt-get install postgresql")
    pytest.importorskip("psycopg", reason="pip install 'credit-rl[server]'")
    with workshop() as folder:
        (folder / "database").mkdir()
        with postgresql(folder / "database") as store, Server(store, folder) as server, writers() as processes:
            answers = upload_together(processes, folder / "outputs", server.uri, 3, 20, 4)
            assert [problem for *_, problem in answers] == [""] * 8
            assert assert_equal_to_journals(server.uri, folder / "outputs") == 8 * 3 * 20
            assert {run.info.status for run in all_runs(server.uri, "seed")} == {"FINISHED"}

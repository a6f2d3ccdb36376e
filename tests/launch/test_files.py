"""The files for Slurm, Ray and an MLflow server, with stand-ins for what they call; slow tests call the real ones."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from credit.bench.reliability_tracking import workshop
from credit.bench.servers import free_port, postgresql, postgresql_programs

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
UNSET = ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH", "RAY_PORT", "PGPASSWORD", "SLURM_SUBMIT_DIR")

StandIn = Callable[[str, str], None]


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StandIn:
    """`stand_in("ray", 'echo "$@"')`: what a command on the path does; the working and home folder is empty."""
    programs, work = tmp_path / "bin", tmp_path / "work"
    programs.mkdir()
    work.mkdir()
    monkeypatch.chdir(work)
    monkeypatch.setenv("HOME", str(work))
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", f"{LAUNCH.parent}:{os.environ.get('PYTHONPATH', '')}")
    for name in UNSET:
        monkeypatch.delenv(name, raising=False)

    def write(name: str, does: str) -> None:
        (programs / name).write_text(f"#!/usr/bin/env bash\n{does}\n")
        (programs / name).chmod(0o755)

    return write


def bash(script: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", str(LAUNCH / script), *words], capture_output=True, text=True, check=False)


def test_the_scripts_can_be_started() -> None:
    assert [path.name for path in sorted(LAUNCH.glob("*.sh")) if not os.access(path, os.X_OK)] == []
    assert (LAUNCH / "slurm.sbatch").read_text().startswith("#!")  # or sbatch refuses it


@pytest.mark.parametrize(
    ("script", "words", "says"),
    [
        ("ray.sh", (), "head ADDRESS, join ADDRESS, stop"),
        ("ray.sh", ("start",), "'start' is nothing that it does"),
        ("ray.sh", ("head",), "needs the address of the first machine"),
        ("ray.sh", ("join", "--block"), "needs the address of the first machine"),
        ("ray.sh", ("join", "10.0.0.1"), "no token on this machine: copy ~/.ray/auth_token"),
        ("mlflow.sh", (), "database, serve, backup"),
        ("mlflow.sh", ("start",), "'start' is nothing that it does"),
        ("mlflow.sh", ("database",), "set PGPASSWORD"),
    ],
)
def test_bad_words(stand_in: StandIn, script: str, words: tuple[str, ...], says: str) -> None:
    for name in ("ray", "mlflow", "runuser"):
        stand_in(name, "touch called")
    ended = bash(script, *words)
    assert ended.returncode == 2
    assert says in ended.stderr
    assert not Path("called").exists()


@pytest.mark.parametrize("script", ["ray.sh", "mlflow.sh"])
def test_help_is_the_head_of_the_file(stand_in: StandIn, script: str) -> None:
    told = bash(script, "--help")
    assert told.returncode == 0
    assert told.stdout.count(f"launch/{script} ") == 3
    assert "set -euo" not in told.stdout


def test_ray_starts_with_a_token(stand_in: StandIn) -> None:
    stand_in(
        "ray", 'echo "$RAY_AUTH_MODE $*"; [[ $1 != get-auth-token ]] || { mkdir -p ~/.ray; echo t >~/.ray/auth_token; }'
    )
    head = bash("ray.sh", "head", "10.0.0.1", "--num-cpus=2")
    assert head.stdout == (
        "token start --head --node-ip-address=10.0.0.1 --port=6379 --include-dashboard=false --num-cpus=2\n"
    )
    assert Path(".ray/auth_token").exists()
    assert bash("ray.sh", "join", "10.0.0.1", "--block").stdout == "token start --address=10.0.0.1:6379 --block\n"


def test_mlflow_is_served_to_this_machine_alone(stand_in: StandIn) -> None:
    stand_in("mlflow", 'echo "$MLFLOW_BACKEND_STORE_URI $MLFLOW_SERVER_ENABLE_JOB_EXECUTION $*"')
    assert bash("mlflow.sh", "serve", "--dev").stdout == (
        "postgresql+psycopg://credit@127.0.0.1/mlflow false server --host 127.0.0.1 --port 5000 --workers 1 "
        "--artifacts-destination /srv/credit/artifacts --dev\n"
    )


def test_the_database_is_made_without_showing_the_password(stand_in: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in("runuser", 'echo "$*"; cat')
    monkeypatch.setenv("PGPASSWORD", "a secret")
    words, statements = bash("mlflow.sh", "database").stdout.split("\n", 1)
    assert words == "-u postgres -- psql -v ON_ERROR_STOP=1 -q"
    assert statements == "CREATE ROLE credit LOGIN PASSWORD 'a secret'; CREATE DATABASE mlflow OWNER credit\n"


@pytest.mark.parametrize("code", [0, 1, 2, 130])
def test_a_slurm_job_ends_as_its_command(stand_in: StandIn, code: int) -> None:
    stand_in("credit", f'echo "$@"; exit {code}')
    stand_in("scontrol", "touch requeued")
    ended = bash("slurm.sbatch", "-m", "sweep=table1")
    assert (ended.returncode, ended.stdout) == (code, "train -m sweep=table1\n")
    assert not Path("requeued").exists()


@pytest.mark.parametrize(("code", "again"), [(130, True), (0, False), (1, False)])
def test_a_slurm_job_whose_time_is_up_queues_again(
    stand_in: StandIn, monkeypatch: pytest.MonkeyPatch, code: int, again: bool
) -> None:
    """It waits for the checkpoints, which take longer than the signal."""
    stand_in("credit", f"trap 'sleep 0.3; touch saved; exit {code}' TERM; touch begun; while true; do sleep 0.05; done")
    stand_in("scontrol", 'echo "$*" >requeued')
    monkeypatch.setenv("SLURM_JOB_ID", "17")
    job = subprocess.Popen(["bash", str(LAUNCH / "slurm.sbatch")])
    end = time.monotonic() + 30
    while not Path("begun").exists() and time.monotonic() < end:
        time.sleep(0.01)
    job.send_signal(signal.SIGTERM)
    assert job.wait(30) == code
    assert Path("saved").exists()
    assert Path("requeued").exists() == again
    assert not again or Path("requeued").read_text() == "requeue 17\n"


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
def test_systemd_takes_the_service(tmp_path: Path) -> None:
    unit = (LAUNCH / "mlflow.service").read_text().replace("/srv/credit/launch/", f"{LAUNCH}/")
    (tmp_path / "mlflow.service").write_text(unit)
    command = ["systemd-analyze", "verify", "--man=no", str(tmp_path / "mlflow.service")]
    checked = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "mlflow.service" not in checked.stderr, checked.stderr


@pytest.mark.slow
def test_a_slurm_job_goes_on_with_its_runs(stand_in: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in("credit", f'exec "{sys.executable}" -m credit.cli.main "$@"')
    stand_in("scontrol", "touch requeued")
    monkeypatch.setenv("SLURM_JOB_ID", "17")
    words = ["experiment=advertiser", "method=disagreement", "replicas=2", "trainer.steps=7000", "tracking=none"]
    job = subprocess.Popen(["bash", str(LAUNCH / "slurm.sbatch"), *words], stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60
    while not list(Path().glob("outputs/*/*/*/seed-0/metrics.csv")) and time.monotonic() < end:
        time.sleep(0.01)
    job.send_signal(signal.SIGTERM)
    assert job.wait(60) == 130
    assert Path("requeued").exists()
    assert list(Path().glob("outputs/*/*/*/seed-0/checkpoint.pt"))
    assert bash("slurm.sbatch", *words).returncode == 0
    assert len(list(Path().glob("outputs/*/*/*/seed-*/DONE"))) == 2


@pytest.mark.slow
def test_the_server_answers_on_postgresql(stand_in: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    if postgresql_programs() is None:
        pytest.skip("PostgreSQL is not installed: apt-get install postgresql")
    pytest.importorskip("psycopg", reason="pip install 'credit-rl[server]'")
    stand_in("mlflow", f'exec "{sys.executable}" -m mlflow "$@"')
    port = free_port()
    with workshop() as folder:
        (folder / "database").mkdir()
        with postgresql(folder / "database") as store:
            monkeypatch.setenv("MLFLOW_BACKEND_STORE_URI", store)
            monkeypatch.setenv("MLFLOW_PORT", str(port))
            monkeypatch.setenv("MLFLOW_ARTIFACTS_DESTINATION", str(folder / "artifacts"))
            log = (folder / "log").open("wb")
            server = subprocess.Popen(
                [str(LAUNCH / "mlflow.sh"), "serve"], stdout=log, stderr=log, start_new_session=True
            )
            try:
                end, answer = time.monotonic() + 120, b""
                while not answer and time.monotonic() < end:
                    time.sleep(0.3)
                    with (
                        suppress(OSError),
                        urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=1) as page,
                    ):
                        answer = page.read()
                assert answer == b"OK", (folder / "log").read_text()
            finally:
                os.killpg(server.pid, signal.SIGKILL)
                server.wait()
                log.close()

"""Sweeps in worker processes: what ends how, what the terminal says, and that nothing is left behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from credit.cli.board import Board
from credit.cli.main import main
from credit.cli.task import Parent
from credit.config import launchers
from credit.core.errors import UserError

from .launching import SHORT, alive, begin, done, environment, kill_group, misbehaving, run, session, status, until

TWO = ("hydra/launcher=local", "hydra.launcher.n_jobs=2")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    misbehaving(tmp_path)
    return tmp_path


@pytest.mark.thorough
def test_one_failing_job(site):
    ended = run(site, "train", "-m", "feedback=block_sum,failing,calm", *TWO, *SHORT)
    assert ended.returncode == 1
    log = session(site) / "job-1.log"
    (line,) = [line for line in ended.stderr.splitlines() if line.startswith("failed")]
    assert "ArithmeticError: no labels today" in line
    assert str(log.relative_to(site)) in line
    assert "Traceback" in log.read_text()
    assert ended.stderr.count("done  ") == 2
    rows = [line.split()[:2] for line in ended.stdout.splitlines() if line.lstrip()[:1].isdigit()]
    assert rows == [["0", "done"], ["2", "done"], ["1", "failed"]]  # what has a result, the best first
    assert "jobs     2 done, 1 failed" in ended.stdout
    assert "seeds    0 done before, 0 resumed, 2 run" in ended.stdout
    assert f"mend what failed, then credit resume {session(site).relative_to(site)}" in ended.stdout
    assert "compare" not in ended.stdout
    assert status(site) == ["FAILED", "FINISHED", "FAILED", "FINISHED"]


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["basic", "local"])
def test_stop_on_error(site, launcher):
    one = ("hydra/launcher=basic",) if launcher == "basic" else ("hydra/launcher=local", "hydra.launcher.n_jobs=1")
    ended = run(site, "train", "-m", "feedback=block_sum,failing,calm,waiting", "sweep.on_error=stop", *one, *SHORT)
    assert ended.returncode == 1
    assert "jobs     1 done, 1 failed, 2 not run" in ended.stdout
    assert done(site) == 1


@pytest.mark.slow
def test_a_line_appears_when_a_job_ends_and_an_interruption_leaves_no_worker(site):
    (site / "wait").touch()
    command = begin(site, "train", "-m", "feedback=block_sum,waiting", "seed=0,1", *TWO, *SHORT)
    try:
        for _ in range(2):  # while two other jobs still wait
            assert command.stderr.readline().startswith("done ")
        workers = until(lambda: len(pids := begun(site)) == 2 and pids)
        command.send_signal(signal.SIGTERM)
        out, err = command.communicate(timeout=60)
    finally:
        kill_group(command)
    assert command.returncode == 130
    assert "stopping" in err
    assert err.count("killed ") == 2
    assert "jobs     2 done, 2 killed" in out
    until(lambda: not any(map(alive, workers)))
    assert sorted(status(site)) == ["FINISHED", "FINISHED", "KILLED", "KILLED", "KILLED"]

    (site / "wait").unlink()
    again = run(site, "train", "-m", "feedback=block_sum,waiting", "seed=0,1", *TWO, *SHORT)
    assert again.returncode == 0, again.stderr
    assert "jobs     2 done, 2 done before" in again.stdout
    assert status(site) == ["FINISHED"] * 5


@pytest.mark.slow
def test_ctrl_c_in_a_terminal_reaches_the_whole_group(site):
    (site / "wait").touch()
    command = begin(site, "train", "-m", "feedback=waiting", "seed=0,1", *TWO, *SHORT)
    try:
        workers = until(lambda: len(pids := begun(site)) == 2 and pids)
        for pid in [command.pid, *workers]:
            signal.pidfd_send_signal(_pidfd(pid), signal.SIGINT)
        out, err = command.communicate(timeout=60)
    finally:
        kill_group(command)
    assert command.returncode == 130
    assert "jobs     2 killed" in out
    assert "Traceback" not in err
    assert status(site) == ["KILLED"] * 3


@pytest.mark.slow
def test_a_second_signal_ends_at_once(site):
    (site / "wait").touch()
    command = begin(site, "train", "-m", "feedback=waiting", "seed=0,1", *TWO, *SHORT)
    try:
        workers = until(lambda: len(pids := begun(site)) == 2 and pids)
        for pid in workers:  # workers that hear nothing
            signal.pidfd_send_signal(_pidfd(pid), signal.SIGSTOP)
        command.send_signal(signal.SIGINT)
        assert "stopping" in command.stderr.readline()
        command.send_signal(signal.SIGINT)
        out, _ = command.communicate(timeout=60)
    finally:
        kill_group(command)
    assert command.returncode == 130
    assert "jobs     2 killed" in out
    assert not any(map(alive, workers))


@pytest.mark.slow
def test_no_worker_outlives_a_command_that_was_killed(site):
    (site / "wait").touch()
    command = begin(site, "train", "-m", "feedback=waiting", "seed=0,1,2", *TWO, *SHORT)
    try:
        workers = until(lambda: len(pids := begun(site)) == 2 and pids)
        command.kill()
        command.wait()
        until(lambda: not any(map(alive, workers)))
    finally:
        kill_group(command)
    assert done(site) == 0


@pytest.mark.slow
def test_a_worker_that_is_killed_takes_no_other_job_with_it(site):
    (site / "kill").touch()
    ended = run(site, "train", "-m", "feedback=killed,block_sum,calm,waiting", *TWO, *SHORT)
    assert ended.returncode == 0, ended.stderr
    assert done(site) == 4


@pytest.mark.slow
def test_submitit(site):
    words = ("train", "-m", "feedback=block_sum,failing,calm", "hydra/launcher=slurm_local", *SHORT)
    ended = run(site, *words)
    assert ended.returncode == 1
    assert "ArithmeticError: no labels today" in ended.stderr
    assert "jobs     2 done, 1 failed" in ended.stdout
    assert status(site) == ["FAILED", "FINISHED", "FAILED", "FINISHED"]


ISOLATED = ["unshare", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]


@pytest.mark.slow
def test_a_ray_cluster_that_loses_a_node_in_mid_sweep(site):
    pytest.importorskip("ray")
    if not shutil.which("unshare") or subprocess.run([*ISOLATED, "true"], capture_output=True, check=False).returncode:
        pytest.skip("two Ray nodes on one machine need a network namespace, which only root can make")
    inside = [*ISOLATED, sys.executable, str(Path(__file__).with_name("two_nodes.py")), str(site)]
    ended = subprocess.run(inside, env=environment(site), capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "jobs     4 done\n" in ended.stdout
    assert status(site) == ["FINISHED"] * 5


def test_a_launcher_that_is_not_installed(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"pip install 'credit-rl\[ray\]'"):
        launchers.choose(["hydra/launcher=ray"], 2, False)
    with pytest.raises(UserError, match="did you mean 'slurm'"):
        launchers.choose(["hydra/launcher=slrum"], 2, False)


def test_the_launcher_that_is_taken_where_none_was_chosen(monkeypatch):
    monkeypatch.setattr(launchers, "_cores", lambda: 4)
    monkeypatch.setattr(launchers, "_devices", lambda: 2)
    assert launchers.choose(["seed=1"], 1, False) == ["hydra/launcher=basic"]
    assert launchers.choose([], 3, False) == ["hydra/launcher=local", "hydra.launcher.n_jobs=3"]
    assert launchers.choose([], 9, False) == ["hydra/launcher=local", "hydra.launcher.n_jobs=4"]
    assert launchers.choose([], 9, True) == ["hydra/launcher=local", "hydra.launcher.n_jobs=2"]
    chosen = ["hydra/launcher=local", "hydra.launcher.n_jobs=1"]
    assert launchers.choose(chosen, 9, False) == chosen
    assert launchers.choose(["hydra/launcher=basic"], 9, False) == ["hydra/launcher=basic"]
    workers = "hydra.launcher.n_jobs=2"
    monkeypatch.setattr(launchers, "_cores", lambda: 1)
    assert launchers.choose([workers], 9, False) == [workers, "hydra/launcher=local"]


def test_the_board(tmp_path):
    board, other = Board(tmp_path), Board(tmp_path)
    board.clear()
    board.lay({0: ({"seed": 3}, ["seed=3"])})
    assert other.job(0) == ({"seed": 3}, ["seed=3"])
    assert board.read() == {}
    other.post(0, {"state": "running"})
    assert board.read() == {0: {"state": "running"}}
    assert other.stopped() == ""
    board.stop("interrupted")
    board.stop("failed")  # weaker
    assert other.stopped() == "interrupted"
    board.end()
    assert other.stopped() == "interrupted"
    board.clear()
    assert other.stopped() == ""


def test_what_is_posted_in_the_same_moment_is_seen(tmp_path):
    board, moment = Board(tmp_path), (1_000_000_000, 1_000_000_000)
    board.clear()
    for state in ("running", "ended"):
        board.post(0, {"state": state})
        os.utime(tmp_path / "now" / "job-0.json", ns=moment)
        assert board.read() == {0: {"state": state}}


def test_whether_the_command_is_gone():
    here = Parent()
    assert here.here()
    assert not here.gone()
    assert Parent(here.host, here.pid, here.started - 1).gone()  # another process had this number
    assert Parent(here.host, 2**22 + 1, here.started).gone()
    assert not Parent("elsewhere", 2**22 + 1, here.started).gone()


def begun(site: Path) -> list[int]:
    """Workers in which a waiting job has begun."""
    return [int(path.name.partition("-")[2]) for path in site.glob("begun-*")]


def _pidfd(pid: int) -> int:
    return os.pidfd_open(pid)


@pytest.mark.parametrize("name", ["it's", "d${x}"])
def test_folders_of_any_name_hold_sweeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / name)
    assert main(["train", "-m", "method=delayed,block", "trainer.steps=70", "replicas=1", "tracking=none"]) == 0
    assert len([*(tmp_path / name).rglob("DONE")]) == 2

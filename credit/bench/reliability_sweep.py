"""A sweep that is killed again and again, and started again by the same command."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from credit.tracking.store import quiet_environment, resolve_uri

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 900.0  # seconds for one attempt


@dataclass(frozen=True)
class Swept:
    """What became of a sweep that was killed.

    Attributes:
        kills: how often. done: runs with a file DONE. again: runs that were finished a second time.
        status: status in MLflow → how many seeds' runs. twice: seeds with more than one run there.
    """

    kills: int
    done: int
    again: int
    status: dict[str, int]
    twice: int


def sweep(folder: Path, jobs: int = 40, kills: int = 5, seed: int = 0) -> Swept:
    """Start a sweep of short jobs on two workers, kill it with all its workers at random moments, start it again.

    Args:
        folder: an empty one. jobs: how many, of one seed each. kills: how many. seed: of the moments.
    """
    output = folder / "outputs"
    words = ["experiment=advertiser", "method=disagreement", "trainer.steps=3500", "replicas=1", f"output={output}"]
    words += [f"seed={','.join(map(str, range(jobs)))}", "hydra/launcher=local", "hydra.launcher.n_jobs=2"]
    command = [sys.executable, "-m", "credit.cli.main", "train", "-m", *words]
    moments, times, again, count = random.Random(seed), dict[Path, float](), 0, 0
    while count < kills:
        ended = _attempt(command, output, kill_after=moments.uniform(0, 4))
        count += not ended
        again += _noted(times, output)
        if ended:
            break
    _attempt(command, output)
    again += _noted(times, output)
    status, twice = stored(output)
    return Swept(count, len(times), again, status, twice)


def stored(output: Path) -> tuple[dict[str, int], int]:
    """How many runs of seeds MLflow has of each status, and how many seeds have more than one."""
    os.environ |= quiet_environment()
    from mlflow import MlflowClient

    client = MlflowClient(resolve_uri(None, output))
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    runs = client.search_runs(experiments, max_results=10_000)
    seeds = [run for run in runs if run.data.tags.get("level") == "seed"]
    folders = Counter((run.data.tags["method"], run.data.tags["seed"]) for run in seeds)
    return dict(Counter(run.info.status for run in runs)), sum(number > 1 for number in folders.values())


def _attempt(command: Sequence[str], output: Path, kill_after: float | None = None) -> bool:
    """Run a command to its end, or kill it and its workers some seconds after another run is done; whether it ended."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    process = subprocess.Popen(
        command,
        cwd=output.parent,
        env=environment,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    if kill_after is not None:
        before, end = len(_done(output)), time.monotonic() + PATIENCE
        while process.poll() is None and len(_done(output)) == before and time.monotonic() < end:
            time.sleep(0.05)
        with suppress(subprocess.TimeoutExpired):
            process.wait(kill_after)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    _, errors = process.communicate(timeout=PATIENCE)
    if process.returncode not in (0, -signal.SIGKILL):
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}: {errors.decode()[-2000:]}")
    return process.returncode == 0


def _done(output: Path) -> list[Path]:
    return sorted(output.glob("*/*/*/seed-*/DONE"))


def _noted(times: dict[Path, float], output: Path) -> int:
    """Note when runs were done; how many were done before, at another time."""
    again = 0
    for path in _done(output):
        written = path.stat().st_mtime
        again += times.get(path, written) != written
        times[path] = written
    return again

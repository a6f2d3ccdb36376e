"""`credit bench reliability`: runs that are killed and gone on with come out as if nothing had happened."""

from __future__ import annotations

import csv
import multiprocessing
import os
import random
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.context import ForkProcess
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
import torch

import credit
from credit.bench import reliability_sweep, reliability_tracking
from credit.bench.measure import Row

KILLS = 20
HALF = "*/*/*/seed-*/.checkpoint.pt"  # a checkpoint that is being written
SMALL = ["seed=0", "replicas=2", "tracking=none", "checkpoint_seconds=0"]
MAZE = [
    *("env.maze=UMaze", "env.start=[1,1]", "env.goal=[3,1]", "env.evaluation_episodes=2", "feedback.window=200"),
    *("trainer.steps=24000", "agent.updates=30", "agent.first_updates=60", "agent.batch=32"),
]
RUNS = {
    "advertiser, Disagreement-UCB": ["experiment=advertiser", "method=disagreement", "trainer.steps=3500"],
    "sepsis, Disagreement-UCB": ["experiment=sepsis", "method=disagreement", "trainer.steps=4000"],
    "sepsis, DQN": ["experiment=sepsis", "method=delayed", "trainer.steps=3000"],
    "PointMaze, SAC and networks": ["experiment=pointmaze", "method=disagreement", *MAZE],
}


@dataclass(frozen=True)
class Survived:
    """What became of a run that was killed.

    Attributes:
        kills: how often. writing: how many of them left half a checkpoint. different: files that differ in the end.
    """

    kills: int
    writing: int
    different: list[str]


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Kill runs and a sweep, and go on with them; burden MLflow; measure what it costs. A quarter of an hour."""
    rows = []
    for name, overrides in RUNS.items():
        say(name)
        with tempfile.TemporaryDirectory() as folder:
            found = killed(overrides, Path(folder), KILLS)
        figure = f"{len(found.different)} ({found.kills}, {found.writing})"
        what = f"{name}: files that differ after kills (how many, how many of them while a checkpoint was written)"
        rows.append(Row(what, figure, "0", not found.different and found.kills >= KILLS))
        say(f"{rows[-1].what}: {figure}")
    say("a sweep")
    rows += swept()
    for row in rows[len(RUNS) :]:
        say(f"{row.what}: {row.figure}")
    return [*rows, *reliability_tracking.run(say)]


def swept(jobs: int = 40, kills: int = 5) -> list[Row]:
    """A sweep on two workers, killed and started again."""
    with tempfile.TemporaryDirectory() as folder:
        found = reliability_sweep.sweep(Path(folder), jobs, kills)
    what = f"a sweep of {jobs} jobs, killed {found.kills} times:"
    status = ", ".join(f"{number} {name}" for name, number in sorted(found.status.items()))
    return [
        Row(f"{what} runs that are done", str(found.done), str(jobs), found.done == jobs and found.kills == kills),
        Row(f"{what} runs that were finished twice", str(found.again), "0", not found.again),
        Row(f"{what} runs in MLflow (sweep, jobs, seeds)", status, "FINISHED", {*found.status} == {"FINISHED"}),
        Row(f"{what} seeds that MLflow has twice", str(found.twice), "0", not found.twice),
    ]


def killed(overrides: Sequence[str], folder: Path, kills: int, seed: int = 0) -> Survived:
    """Compute a run twice, once undisturbed, once with SIGKILL at random moments; compare what they leave.

    Args:
        overrides: of the run. folder: an empty one. kills: how many. seed: of the moments.
    """
    whole, broken = ([*SMALL, *overrides, f"output={folder / name}"] for name in ("whole", "broken"))
    begun = time.monotonic()
    if _child(whole).exitcode:
        raise RuntimeError(f"the undisturbed run failed: {overrides}")
    pause, moments = (time.monotonic() - begun) / (2 * kills), random.Random(seed)
    count = writing = 0
    while count < kills:
        half = folder / "broken" if count % 2 else None
        if _child(broken, moments.uniform(0, pause), half).exitcode == 0:
            break  # it was done before its time
        count += 1
        writing += any((folder / "broken").glob(HALF))
    if _child(broken).exitcode:
        raise RuntimeError(f"a run could not be gone on with: {overrides}")
    return Survived(count, writing, different(folder / "whole", folder / "broken"))


def different(first: Path, second: Path) -> list[str]:
    """Files of the runs in one output folder that are not the same in another, times left out."""
    found = []
    for done in sorted(first.glob("*/*/*/seed-*/DONE")):
        for name in ("metrics.csv", "recovery.npz", "trajectories.npz"):
            one = done.with_name(name)
            other = second / one.relative_to(first)
            if one.exists() and not (other.exists() and _content(one) == _content(other)):
                found.append(str(one.relative_to(first)))
        if not (second / done.relative_to(first)).exists():
            found.append(str(done.relative_to(first)))
    return found


def _content(file: Path) -> object:
    if file.suffix == ".npz":
        with np.load(file) as arrays:
            return {name: (array.shape, array.tobytes()) for name, array in arrays.items()}
    with file.open(newline="", encoding="utf-8") as rows:
        return [{key: cell for key, cell in row.items() if key != "time/seconds"} for row in csv.DictReader(rows)]


def _child(overrides: Sequence[str], until: float | None = None, half: Path | None = None) -> ForkProcess:
    """A run in a process of its own, killed after some seconds of computing if it is not done by then.

    Args:
        half: an output folder; the kill waits until half a checkpoint lies in it.
    """
    context = multiprocessing.get_context("fork")  # what is imported is there at once
    begun = context.Event()
    process = context.Process(target=_run, args=(list(overrides), begun))
    process.start()
    if until is not None:
        while process.is_alive() and not begun.wait(0.01):
            continue
        process.join(until)
        while half and process.is_alive() and not any(half.glob(HALF)):
            continue
        process.kill()
    process.join()
    return process


def _run(overrides: list[str], begun: Event) -> None:
    torch.set_num_threads(1)
    status = credit.run(overrides, progress=lambda *_: begun.set()).status
    os._exit(status != "FINISHED")

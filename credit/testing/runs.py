"""What a run of any part owes: the same again, the same alone, and to be gone on with to the bit."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from credit.config import schema
from credit.core.problem import Problem
from credit.runs import checkpoint
from credit.testing.cases import WORLDS, Case
from credit.testing.expect import close, expect
from credit.testing.short import SEEDS
from credit.trainer import Trainer

Rows = list[tuple[int, dict[str, torch.Tensor]]]
STATE = "make every attribute that changes in `start`, and name it in `keeps` where the class has one"
ROUNDED = 1e-3  # of the largest number: how far a replica beside others may be from what it is alone
STREAMS = "draw random numbers from a Stream or from generators of credit.core.streams, made in `start`"


def started(config: Mapping[str, Any], seeds: tuple[int, ...]) -> Trainer:
    """A trainer at the beginning of its run."""
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start(seeds)
    return trainer


def played(trainer: Trainer, folder: Path | None = None) -> Rows:
    """Run to the end; with a folder, leave a checkpoint there between any two rounds."""
    rows: Rows = []

    def between() -> None:
        if folder is not None:
            checkpoint.save(folder / f"{trainer.rounds}", {"trainer": trainer.state_dict(), "rows": len(rows)})

    trainer.run(lambda step, values: rows.append((step, values)), between=between)
    return rows


def differing(one: Any, other: Any, where: str = "") -> list[str]:
    """What is not the same to the bit in two states or journals."""
    if isinstance(one, torch.Tensor) and isinstance(other, torch.Tensor) and one.shape == other.shape:
        bits = [part.contiguous().numpy().tobytes() for part in (one, other)]
        return [] if one.dtype == other.dtype and bits[0] == bits[1] else [where]
    if isinstance(one, Mapping) and isinstance(other, Mapping) and list(one) == list(other):
        return [found for key in one for found in differing(one[key], other[key], f"{where}.{key}")]
    if isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return [found for i, pair in pairs for found in differing(*pair, f"{where}.{i}")]
    return [] if type(one) is type(other) and repr(one) == repr(other) else [where]  # NaN is NaN


def goes_on(config: Mapping[str, Any], folder: Path, seeds: tuple[int, ...], which: slice) -> None:
    """Interrupt a run between any two rounds, or after some of them, and compare what comes of it.

    Args:
        config: of the run. folder: for checkpoints. seeds: one a replica. which: of the rounds.
    """
    whole = started(config, seeds)
    rows = played(whole, folder)
    files = sorted(folder.iterdir(), key=lambda file: int(file.name))
    expect(len(files) >= 2, f"a run of {len(files)} rounds cannot be interrupted")
    for file in files[which]:
        state = checkpoint.load(file)
        trainer = started(config, seeds)
        trainer.load_state_dict(state["trainer"])
        _same(trainer.state_dict(), state["trainer"], f"loaded after round {file.name}")
        _same(played(trainer), rows[state["rows"] :], f"rows after round {file.name}")
        _same(trainer.state_dict(), whole.state_dict(), f"the end, from round {file.name} on")


def _same(one: Any, other: Any, when: str) -> None:
    found = differing(one, other)
    expect(not found, f"{when}: {', '.join(found[:8])} differ from the undisturbed run; {STATE}")


def resumes(case: Case) -> None:
    """A run that was stopped and gone on with is the run that was not stopped, to the bit."""
    with tempfile.TemporaryDirectory() as folder:
        goes_on(case.config, Path(folder), (*SEEDS, 5), slice(1, 2))


def repeats(case: Case) -> None:
    """The same seeds are the same run, to the bit."""
    one, other = started(case.config, SEEDS), started(case.config, SEEDS)
    found = differing(played(one), played(other)) or differing(one.state_dict(), other.state_dict())
    expect(not found, f"two runs with the same seeds differ in {', '.join(found[:8])}; {STREAMS}")


def alone(case: Case) -> None:
    """A replica beside others does what it does alone, to rounding, as long as few rounds do not magnify that."""
    beside, single = (_told(case, seeds) for seeds in (SEEDS, SEEDS[:1]))
    for name, wanted in single.items():
        why = f"a replica's {name} depend on who is beside it: random numbers, or sums over replicas; {STREAMS}"
        size = float(wanted.abs().max()) or 1.0
        close(beside[name][:1, : wanted.shape[1]] / size, wanted / size, why, ROUNDED)


def _told(case: Case, seeds: tuple[int, ...]) -> dict[str, torch.Tensor]:
    """What two rounds come to; of those who decide what happens, under actions that are the same whatever happens."""
    trainer = started(case.config, seeds)
    if case.kind in WORLDS:
        windows, rewards = trainer.collector.collect(Steady(trainer.problem), 3)
    else:
        trainer.steps = 2 * trainer.windows_per_round * trainer.problem.window
        played(trainer)
        windows = trainer.store.windows
        rewards = trainer.assigner.rewards(windows)
    found = {name: getattr(windows, name) for name in ("states", "actions", "labels")}
    return found | {"rewards": rewards}


class Steady:
    """Acts by the step alone, the same in all copies.

    Args:
        problem: whose actions.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        """One action after the other [R, K], or a vector that swings [R, K, A]."""
        if self._problem.finite_actions:
            return step % self._problem.actions
        return step.float().cos().unsqueeze(-1).expand(*step.shape, self._problem.actions)

"""The arrays of a run folder: what a learner believes, and in mazes where it went; anybody can recompute them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from credit.core.continuous import Moves, StepBelief, Trajectories
from credit.core.dataset import Dataset
from credit.core.state import Stateful, pack, unpack
from credit.core.types import Recovery
from credit.recovery.step_recovery import StepRecovery
from credit.trainer import Trainer

Arrays = dict[str, np.ndarray]


class Recorder(Stateful):
    """Arrays of each run of a job: `recovery.npz`, and `trajectories.npz` where states are real numbers.

    Args:
        trainer: of the job, started.
    """

    def __init__(self, trainer: Trainer) -> None:
        self._trainer = trainer
        self._grid: Moves | None = trainer.env.grid()
        self._rounds: list[tuple[int, StepBelief]] = []

    def note(self, step: int) -> None:
        """Keep what is believed now of a grid, if there is one to look at."""
        grid, assigner, problem = self._grid, self._trainer.assigner, self._trainer.problem
        if grid is None or not isinstance(assigner, StepRecovery):
            return
        count = problem.replicas
        states, actions, arrivals = (part.repeat(count, 1) for part in (grid.states, grid.actions, grid.next_states))
        whose = torch.arange(count, device=problem.device).repeat_interleave(len(grid))
        self._rounds.append((step // problem.window, assigner.believe(Moves(states, actions, arrivals, whose))))

    def state_dict(self) -> dict[str, Any]:
        """What was believed after each round so far."""
        names = [field.name for field in fields(StepBelief)]
        return {
            "rounds": [
                [step, {name: pack(getattr(belief, name), name) for name in names}] for step, belief in self._rounds
            ]
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Have noted these rounds and no others."""
        self._rounds = [
            (step, StepBelief(**{name: unpack(packed, None, name) for name, packed in belief.items()}))
            for step, belief in state["rounds"]
        ]

    def files(self, replica: int) -> dict[str, Arrays]:
        """File name → arrays of one replica."""
        trainer, found = self._trainer, dict[str, Arrays]()
        recovery = trainer.recovery()
        if isinstance(recovery, Recovery):
            policy = trainer.optimizer.policies()["behaviour"]
            truth, summary = trainer.oracle.truth(recovery.cells), trainer.env.summary(recovery.cells)
            found["recovery.npz"] = recovery_arrays(replica, trainer.dataset, recovery, truth, policy, summary)
        if self._grid is not None and self._rounds:
            found["recovery.npz"] = grid_arrays(replica, self._grid, self._rounds)
        if isinstance(trainer.dataset.windows, Trajectories):
            found["trajectories.npz"] = trainer.env.picture(replica) | online_arrays(replica, trainer)
        return found


def grid_arrays(replica: int, grid: Moves, rounds: list[tuple[int, StepBelief]]) -> Arrays:
    """What was believed of a grid of N moves after each of Q refits: [Q, N] unless said.

    `models` (names, the reference first); `rounds` [Q], trajectories collected before; `grid/states` [N, O],
    `grid/actions` [N, A]; and the same names as in tabular files.
    """
    beliefs = [belief.of(replica) for _, belief in rounds]
    last = beliefs[-1]

    def table(values: list[Tensor]) -> np.ndarray:
        return torch.stack(values).cpu().numpy()

    arrays = {
        "models": np.array(last.models),
        "rounds": np.array([count for count, _ in rounds]),
        "grid/states": grid.states.cpu().numpy(),
        "grid/actions": grid.actions.cpu().numpy(),
        "reward/mixed": table([belief.mixed[0] for belief in beliefs]),
        "reward/plan": table([belief.plan[0] for belief in beliefs]),
        "best": table([belief.best[0] for belief in beliefs]),
    }
    for index, name in enumerate(last.models):
        arrays[f"reward/{name}"] = table([belief.mean[0, index] for belief in beliefs])
        arrays[f"mse/{name}"] = table([belief.mse[0, index] for belief in beliefs])
        arrays[f"weight/{name}"] = table([belief.weights[0, index] for belief in beliefs])
        if index:
            arrays[f"disagreement/{name}"] = table([belief.disagreement[0, index - 1] for belief in beliefs])
    return arrays | {f"bonus/{name}": table([belief.bonus[name][0] for belief in beliefs]) for name in last.bonus}


def online_arrays(replica: int, trainer: Trainer) -> Arrays:
    """`online/states` [n, O], trajectory after trajectory, `online/lengths` and `online/labels` [K]."""
    windows: Trajectories = trainer.dataset.windows
    count = len(trainer.dataset) - trainer.collected
    mine = (windows.replica == replica) & (windows.number >= count)
    return {
        "online/states": windows.states[mine].cpu().numpy(),
        "online/lengths": windows.lengths[replica, count:].long().cpu().numpy(),
        "online/labels": windows.labels[replica, count:].cpu().numpy(),
    }


def recovery_arrays(
    replica: int, dataset: Dataset, recovery: Recovery, truth: Tensor, policy: Tensor, summary: Mapping[str, Tensor]
) -> Arrays:
    """Arrays of one replica, tables over `cells` (the names of the axes: [S, A] by default) unless said.

    `windows/states`, `windows/actions`, `windows/next_states` [K, T], `windows/labels` [K]; `models` (names, the
    reference first); `reward/true`, `reward/<model>`, `draws/<model>` [B, ...], `mse/<model>`,
    `disagreement/<surrogate>` (Δ̂²), `weight/<model>`, `best`, `reward/mixed`, `bonus/<name>`, `reward/plan`, `visits`;
    `policy` [S], or [T, S] by step; and `axis/<name>`, two small axes over which a large table can be shown.
    """
    shape = recovery.cells.sizes

    def table(values: Tensor) -> np.ndarray:
        return values.cpu().numpy().reshape(*values.shape[:-1], *shape)

    windows = dataset.windows
    arrays = {
        "windows/states": windows.states[replica].cpu().numpy().astype(np.int32),
        "windows/actions": windows.actions[replica].cpu().numpy().astype(np.int32),
        "windows/next_states": windows.next_states[replica].cpu().numpy().astype(np.int32),
        "windows/labels": windows.labels[replica].cpu().numpy(),
        "models": np.array(recovery.models),
        "cells": np.array(recovery.cells.axes),
        "reward/true": table(truth),
        "reward/mixed": table(recovery.mixed[replica]),
        "reward/plan": table(recovery.plan[replica]),
        "best": table(recovery.best[replica]),
        "visits": table(recovery.visits[replica]),
        "policy": policy[replica].cpu().numpy(),
    }
    for index, name in enumerate(recovery.models):
        arrays[f"reward/{name}"] = table(recovery.mean[replica, index])
        draws = recovery.draws[index][replica]
        arrays[f"draws/{name}"] = table(draws if recovery.column is None else draws[:, recovery.column[replica]])
        arrays[f"mse/{name}"] = table(recovery.mse[replica, index])
        arrays[f"weight/{name}"] = table(recovery.weights[replica, index])
        if index:
            arrays[f"disagreement/{name}"] = table(recovery.disagreement[replica, index - 1])
    arrays |= {f"axis/{name}": table(values).astype(np.int32) for name, values in summary.items()}
    for name, bonus in recovery.bonus.items():
        arrays[f"bonus/{name}"] = table(bonus[replica])
    return arrays


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an .npz file atomically."""
    temporary = path.with_name(f".{path.name}")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    temporary.replace(path)

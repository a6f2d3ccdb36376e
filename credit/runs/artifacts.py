"""The arrays of a run folder: what a learner believes, and in mazes where it went; anybody can recompute them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from credit.core.belief import Belief
from credit.core.policy import tabulate
from credit.core.state import Stateful, pack, unpack
from credit.core.steps import Steps
from credit.core.windows import Windows
from credit.recovery.recovery import Recovery
from credit.trainer import Trainer

Arrays = dict[str, np.ndarray]


class Recorder(Stateful):
    """Arrays of each run of a job: `recovery.npz`, and `trajectories.npz` where states are real numbers.

    Args:
        trainer: of the job, started.
    """

    def __init__(self, trainer: Trainer) -> None:
        self._trainer = trainer
        self._grid: Steps | None = trainer.env.grid()
        self._rounds: list[tuple[int, Belief]] = []

    def note(self, step: int) -> None:
        """Keep what is believed now of a grid, if there is one to look at."""
        grid, assigner = self._grid, self._trainer.assigner
        if grid is not None and isinstance(assigner, Recovery):
            self._rounds.append((step // self._trainer.problem.window, assigner.believe(grid)))

    def state_dict(self) -> dict[str, Any]:
        """What was believed after each round so far."""
        names = [field.name for field in fields(Belief)]
        return {
            "rounds": [
                [step, {name: pack(getattr(belief, name), name) for name in names}] for step, belief in self._rounds
            ]
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Have noted these rounds and no others."""
        self._rounds = [
            (step, Belief(**{name: unpack(packed, None, name) for name, packed in belief.items()}))
            for step, belief in state["rounds"]
        ]

    def files(self, replica: int) -> dict[str, Arrays]:
        """File name → arrays of one replica."""
        trainer, found = self._trainer, dict[str, Arrays]()
        belief = trainer.belief()
        if belief is not None and belief.cells is not None:
            policy = tabulate(trainer.agent.policies()["behaviour"], trainer.problem)
            truth, summary = trainer.judge.truth(belief.cells), trainer.env.summary(belief.cells)
            if truth is None:  # nobody knows it
                truth = torch.full_like(belief.mixed[0], torch.nan)
            found["recovery.npz"] = recovery_arrays(replica, trainer.store.windows, belief, truth, policy, summary)
        if self._grid is not None and self._rounds:
            found["recovery.npz"] = grid_arrays(replica, self._grid, self._rounds)
        if not trainer.problem.tabular:
            seen = trainer.env.picture(replica) | trainer.judge.picture(replica)
            found["trajectories.npz"] = seen | online_arrays(replica, trainer)
        return found


def grid_arrays(replica: int, grid: Steps, rounds: list[tuple[int, Belief]]) -> Arrays:
    """What was believed of a grid of N moves after each of Q refits: [Q, N] unless said.

    `models` (names, the reference first); `rounds` [Q], trajectories collected before; `grid/states` [N, O],
    `grid/actions` [N, A]; and the same names as in tabular files.
    """
    beliefs = [belief for _, belief in rounds]
    last = beliefs[-1]

    def table(values: list[Tensor]) -> np.ndarray:
        return torch.stack(values).cpu().numpy()

    arrays = {
        "models": np.array(last.models),
        "rounds": np.array([count for count, _ in rounds]),
        "grid/states": grid.states.cpu().numpy(),
        "grid/actions": grid.actions.cpu().numpy(),
        "reward/mixed": table([belief.mixed[replica] for belief in beliefs]),
        "reward/plan": table([belief.plan[replica] for belief in beliefs]),
        "best": table([belief.best[replica] for belief in beliefs]),
    }
    for index, name in enumerate(last.models):
        arrays[f"reward/{name}"] = table([belief.mean[replica, index] for belief in beliefs])
        arrays[f"mse/{name}"] = table([belief.mse[replica, index] for belief in beliefs])
        arrays[f"weight/{name}"] = table([belief.weights[replica, index] for belief in beliefs])
        if index:
            arrays[f"disagreement/{name}"] = table([belief.disagreement[replica, index - 1] for belief in beliefs])
    return arrays | {f"bonus/{name}": table([belief.bonus[name][replica] for belief in beliefs]) for name in last.bonus}


def online_arrays(replica: int, trainer: Trainer) -> Arrays:
    """`online/states` [n, O], window after window, `online/lengths` and `online/labels` [K], NaN for none."""
    if not len(trainer.store):  # no label came
        return {}
    windows, skipped = trainer.store.windows, trainer.given
    first = int(windows.ends[replica, skipped - 1]) + 1 if skipped else 0
    last = int(windows.ends[replica, -1]) + 1
    there = windows.lengths[replica, skipped:] > 0
    return {
        "online/states": windows.states[replica, first:last].cpu().numpy(),
        "online/lengths": windows.lengths[replica, skipped:][there].cpu().numpy(),
        "online/labels": labels(windows, replica)[skipped:][there].cpu().numpy(),
    }


def labels(windows: Windows, replica: int) -> Tensor:
    """The labels [K] of a replica's windows, NaN where there is none."""
    found = windows.labels[replica]
    return found if windows.labelled is None else torch.where(windows.labelled[replica], found, torch.nan)


def recovery_arrays(
    replica: int, windows: Windows, belief: Belief, truth: Tensor, policy: Tensor | None, summary: Mapping[str, Tensor]
) -> Arrays:
    """Arrays of one replica, tables over `cells` (the names of the axes: [S, A] by default) unless said.

    `windows/states`, `windows/actions`, `windows/next_states` [K, T] (−1 behind the end of a window that ended early),
    `windows/labels` [K], NaN where there is none; `models` (names, the reference first); `reward/true` (NaN where it is
    not known), `reward/<model>`, `draws/<model>` [B, ...], `mse/<model>`,
    `disagreement/<surrogate>` (Δ̂²), `weight/<model>`, `best`, `reward/mixed`, `bonus/<name>`, `reward/plan`, `visits`;
    `policy` [S], or [T, S] by step, where the policy can say it; and `axis/<name>`, two small axes over which a large
    table can be shown.
    """
    assert belief.cells is not None
    assert belief.visits is not None
    shape = belief.cells.sizes

    def table(values: Tensor) -> np.ndarray:
        return values.cpu().numpy().reshape(*values.shape[:-1], *shape)

    arrays = {
        "windows/states": by_window(windows, windows.states, replica),
        "windows/actions": by_window(windows, windows.actions, replica),
        "windows/next_states": by_window(windows, windows.next_states, replica),
        "windows/labels": labels(windows, replica)[windows.lengths[replica] > 0].cpu().numpy(),
        "models": np.array(belief.models),
        "cells": np.array(belief.cells.axes),
        "reward/true": table(truth),
        "reward/mixed": table(belief.mixed[replica]),
        "reward/plan": table(belief.plan[replica]),
        "best": table(belief.best[replica]),
        "visits": table(belief.visits[replica]),
    }
    if policy is not None:
        arrays["policy"] = policy[replica].cpu().numpy()
    for index, name in enumerate(belief.models):
        arrays[f"reward/{name}"] = table(belief.mean[replica, index])
        if (every := belief.draws[index]) is not None:
            draws = every[replica]
            arrays[f"draws/{name}"] = table(draws if belief.column is None else draws[:, belief.column[replica]])
        arrays[f"mse/{name}"] = table(belief.mse[replica, index])
        arrays[f"weight/{name}"] = table(belief.weights[replica, index])
        if index:
            arrays[f"disagreement/{name}"] = table(belief.disagreement[replica, index - 1])
    arrays |= {f"axis/{name}": table(values).astype(np.int32) for name, values in summary.items()}
    for name, bonus in belief.bonus.items():
        arrays[f"bonus/{name}"] = table(bonus[replica])
    return arrays


def by_window(windows: Windows, numbers: Tensor, replica: int) -> np.ndarray:
    """Numbers of rows [R, n] of one replica, window by window [K, T]; −1 behind the end of one that ended early."""
    if windows.length is not None:
        return windows.grid(numbers)[replica].cpu().numpy().astype(np.int32)
    lengths = [length for length in windows.lengths[replica].tolist() if length]
    parts = numbers[replica, : int(windows.ends[replica, -1]) + 1].split(lengths)
    return pad_sequence(list(parts), batch_first=True, padding_value=-1).cpu().numpy().astype(np.int32)


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an .npz file atomically."""
    temporary = path.with_name(f".{path.name}")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    temporary.replace(path)

"""`recovery.npz`: what a learner believes at the end, as arrays that anybody can recompute."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from torch import Tensor

from credit.dataset import Dataset
from credit.types import Recovery


def recovery_arrays(
    replica: int, dataset: Dataset, recovery: Recovery, truth: Tensor, policy: Tensor, summary: Mapping[str, Tensor]
) -> dict[str, np.ndarray]:
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


def write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write an .npz file atomically."""
    temporary = path.with_name(f".{path.name}")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    temporary.replace(path)

"""What a learner believes about the reward, as tables of numbers on colours (the paper's Figure 5)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from credit.errors import UserError
from credit.report.comparison import display_name, ordered_groups
from credit.report.runs import Runs
from credit.report.statistics import Array

MOST_CELLS = 60
COLUMNS = 3


def heatmaps_figure(runs: Runs, seed: int | None = None) -> Figure | None:
    """Truth, every reward model, the mixture and the reference's weight over states and actions.

    Shown is `disagreement`, or the first method that recovers a reward where it has no runs.

    Args:
        runs: finished runs.
        seed: draw this seed alone; by default the mean over all seeds.

    Returns:
        The figure, or None where the runs have no recovery, or more than 60 (state, action) pairs.

    Raises:
        UserError: the seed is not among the runs.
    """
    groups = sorted(ordered_groups(runs), key=lambda entry: entry[0] != "disagreement")
    group = next((frame for _, _, frame in groups if _recovery_file(frame["folder"].iloc[0]).exists()), None)
    if group is None:
        return None
    name = display_name(group)
    if seed is not None and seed not in set(group["seed"]):
        raise UserError(
            f"diagnostics_seed={seed} is not among the finished seeds of {name}: "
            f"{group['seed'].min()} to {group['seed'].max()}."
        )
    chosen = group if seed is None else group[group["seed"] == seed]
    files = [_recovery_file(folder) for folder in chosen["folder"]]
    panels = _mean_tables(files)
    if panels is None:
        return None
    rewards, weight_name, weight = panels
    rows = -(-(len(rewards) + 1) // COLUMNS)
    figure = Figure(figsize=(11.2, 0.6 + 1.55 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False)
    every = np.stack([table for _, table in rewards])
    scale = Normalize(float(every.min()), float(every.max()))
    shades, share = colormaps["viridis"], Normalize(0, 1)
    *places, last = grid.ravel()
    for axes, (title, table) in zip(places, rewards, strict=False):
        _draw(axes, table, title, shades, scale)
    for axes in places[len(rewards) :]:
        axes.set_visible(False)
    _draw(last, weight, weight_name, colormaps["Blues"], share)
    who = f"seed {chosen['seed'].iloc[0]}" if len(files) == 1 else f"mean over {len(files)} seeds"
    figure.suptitle(f"{name}, end of training, {who}", fontsize=10, x=0.01, ha="left")
    # The weight stands last in the last row, so that its bar can stand beside it.
    for part, limits, colours, label in (
        (grid[:-1], scale, shades, "reward"),
        (grid[-1], share, colormaps["Blues"], "weight"),
    ):
        bar = figure.colorbar(ScalarMappable(limits, colours), ax=part, fraction=0.02, pad=0.01)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=7.5)
        bar.set_label(label, fontsize=8)
    return figure


def _recovery_file(folder: str) -> Path:
    return Path(folder) / "recovery.npz"


def _mean_tables(files: Sequence[Path]) -> tuple[list[tuple[str, Array]], str, Array] | None:
    """Reward tables [A, S] with their titles, and the reference's weight [A, S], averaged over files."""
    stacks: dict[str, list[Array]] = {}
    models: list[str] = []
    for path in files:
        with np.load(path, allow_pickle=False) as data:
            models = [str(model) for model in data["models"]]
            keys = [
                "reward/true",
                *(f"reward/{model}" for model in models),
                "reward/mixed",
                f"weight/{models[0]}",
            ]
            if not all(key in data and data[key].ndim == 2 for key in keys):
                return None
            for key in keys:
                stacks.setdefault(key, []).append(np.asarray(data[key], dtype=float))
    means = {key: np.mean(tables, axis=0) for key, tables in stacks.items()}
    truth = np.stack(stacks["reward/true"])
    if truth[0].size > MOST_CELLS:
        return None
    rewards = [("True reward", means["reward/true"].T)]
    for key in [*(f"reward/{model}" for model in models), "reward/mixed"]:
        error = float(np.mean((np.stack(stacks[key]) - truth) ** 2))
        name = key.removeprefix("reward/").replace("_", " ").capitalize()
        rewards.append((f"{name} reward (MSE {error:.2g})", means[key].T))
    weight = f"weight/{models[0]}"
    return rewards, f"Weight of {models[0].replace('_', ' ')}", means[weight].T


def _draw(axes: Axes, table: Array, title: str, colours: Colormap, scale: Normalize) -> None:
    axes.imshow(table, cmap=colours, norm=scale, aspect="auto", origin="lower")
    for (action, state), value in np.ndenumerate(table):
        red, green, blue, _ = colours(float(scale(value)))
        bright = 0.299 * red + 0.587 * green + 0.114 * blue > 0.55
        axes.text(
            state,
            action,
            _short(value),
            ha="center",
            va="center",
            fontsize=7,
            color="black" if bright else "white",
        )
    axes.set_title(title, fontweight="normal")
    axes.set_xticks(range(table.shape[1]))
    axes.set_yticks(range(table.shape[0]))
    axes.tick_params(length=0, labelsize=7.5)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("state", fontsize=8, labelpad=2)
    axes.set_ylabel("action", fontsize=8, labelpad=4)


def _short(value: float) -> str:
    """Two decimals without the leading zero, as in −.05."""
    digits = f"{abs(value):.2f}".removeprefix("0")
    return digits if value > -0.005 else "−" + digits

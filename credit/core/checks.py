"""What windows must be before anybody learns from them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.windows import Windows

BOUND = 1 + 1e-6  # what rounding may make of an action on the border


def check_windows(windows: Windows, problem: Problem) -> None:
    """Refuse windows that do not fit a problem: a model would take action 2 of 2 for the next state's action 0.

    Args:
        windows: K windows of each of R replicas. problem: in whose spaces they must lie.

    Raises:
        UserError: a shape, a border, a label, a state or an action is not what it must be; with the value and where.
    """
    if windows.labels.dim() != 2:
        raise UserError(
            f"labels have the shape {list(windows.labels.shape)}, and here they must be [replicas, windows]"
        )
    replicas, count = windows.labels.shape
    if windows.length is None and windows.last is None:
        raise UserError("windows say neither their length nor their last rows; give length=T, or last [R, K]")
    if replicas != problem.replicas:
        raise UserError(f"windows of {replicas} replicas, and the problem has {problem.replicas} (one a seed)")
    if windows.length is not None and len(windows) != count * windows.length:
        raise UserError(f"{len(windows)} rows are not {count} windows of {windows.length} steps")
    longest = windows.length if windows.length is not None else int(windows.lengths.max()) if count else 0
    if longest > problem.window:
        raise UserError(f"a window has {longest} steps, and in this problem one has at most {problem.window}")
    if windows.last is not None:
        rows = len(windows) if windows.count is None else windows.count.unsqueeze(1)
        allowed = "windows have at least one row each, and lie within the rows of their replica"
        some = windows.lengths > 0 if windows.labelled is None else (windows.lengths > 0) | ~windows.labelled
        _refuse(some & (windows.last < rows), windows.last, "last row", "window", problem, allowed)
    if windows.labelled is not None and windows.labelled.shape != windows.labels.shape:
        shapes = f"{list(windows.labelled.shape)}, and labels {list(windows.labels.shape)}"
        raise UserError(f"labelled has the shape {shapes}: it says of each window whether it has one")
    _refuse(windows.labels.isfinite(), windows.labels, "label", "window", problem, "labels are finite numbers")
    state = problem.states if problem.finite_states else None
    action = problem.actions if problem.finite_actions else None
    _check_column(windows, windows.states, "state", state, problem, problem.observation_space.shape)
    _check_column(windows, windows.actions, "action", action, problem, problem.action_space.shape)
    _check_column(windows, windows.next_states, "next state", state, problem, problem.observation_space.shape)


def check_rewards(windows: Windows, rewards: Tensor, problem: Problem) -> None:
    """Refuse rewards [R, n] of rows that are no numbers.

    Raises:
        UserError: with the first of them and where it is.
    """
    good = rewards.isfinite()
    good = good if windows.valid is None else good | ~windows.valid
    _refuse(good, rewards, "reward", "row", problem, "rewards are finite numbers")


def require_finite(what: str, values: Tensor | Iterable[Tensor], seeds: Sequence[int], why: str) -> None:
    """Refuse what somebody has learned, where it is no number: a policy could still be read off it, without a word.

    Args:
        what: whose it is, for the message. values: weights or values, each [R·m, ...], m of each replica side by side.
        seeds: one a replica. why: what comes behind that: when it was, and what to do.

    Raises:
        RunError: with the seeds whose values are not finite.
    """
    parts = [values] if isinstance(values, Tensor) else list(values)
    with torch.no_grad():
        if all(math.isfinite(float(part.sum())) for part in parts):  # it may overflow, so that only a doubt comes of it
            return
        finite = torch.stack([part.isfinite().reshape(len(seeds), -1).all(1) for part in parts]).all(0)
    if bad := [str(seed) for seed, good in zip(seeds, finite.tolist(), strict=True) if not good]:
        raise RunError(f"{what} of seed {', '.join(bad)} is not finite{why}")


def require_equal_lengths(model: str, windows: Windows) -> None:
    """Refuse windows that may end early, for a reward model that lays them side by side.

    Raises:
        RunError: windows do not say their one length.
    """
    if windows.length is None:
        raise RunError(
            f"reward model {model!r} needs windows that all have as many steps, and here they may end early; use a "
            "linear model whose features look at states and actions, with credit=every_step"
        )


def _check_column(
    windows: Windows, values: Tensor, what: str, size: int | None, problem: Problem, shape: tuple[int, ...] | None
) -> None:
    """Refuse a column of rows that does not lie in a space of `size` numbers, or of vectors of some shape."""
    wanted = (len(windows.labels), len(windows), *(shape or ()))
    if values.shape != wanted:
        raise UserError(f"{what}s have the shape {list(values.shape)}, and here they must have {list(wanted)}")
    if size is None:
        good, allowed = values.isfinite().flatten(2).all(-1), f"{what}s are finite numbers"
        if what == "action":
            good, allowed = good & (values.flatten(2).abs() <= BOUND).all(-1), "actions are numbers in [-1, 1]"
    elif values.dtype != torch.int64:
        raise UserError(f"{what}s are {values.dtype}, and here they are whole numbers, torch.int64")
    else:
        good, allowed = (values >= 0) & (values < size), f"{what}s are whole numbers from 0 to {size - 1}"
    _refuse(good if windows.valid is None else good | ~windows.valid, values, what, "row", problem, allowed)


def _refuse(good: Tensor, values: Tensor, what: str, unit: str, problem: Problem, allowed: str) -> None:
    """Raise UserError with the first value that is not good [R, n]."""
    if good.all():
        return
    replica, place = (int(i) for i in (~good).nonzero()[0])
    found = values[replica, place].tolist()
    raise UserError(f"{unit} {place} of seed {problem.seeds[replica]} has the {what} {found}: {allowed}")

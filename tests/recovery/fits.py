"""Models on their own: weights that a test knows, and windows that come piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

import torch
from torch import Tensor

from credit.core.cells import Axis, Cells
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Places, RewardModel
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.places import Rows, Table
from credit.recovery.proxies import spread
from credit.recovery.uncertainty.bootstrap import FitUncertainty, Weights


class Given(FitUncertainty):
    """Weights that a test gives, of the newest windows or of all; ones where it gives none."""

    def __init__(self, draws: int = 0) -> None:
        self.draws = draws
        self.next: Tensor | None = None
        self.anew = False

    def weights(self, store: Store) -> Weights:
        labels = (store.windows if self.anew else store.new).labels
        given = torch.ones(*labels.shape, 1 + self.draws, dtype=FLOAT) if self.next is None else self.next
        assert given.shape == (*labels.shape, 1 + self.draws)
        return Weights(given, self.anew)

    def variance(self, draws: Tensor, leverage: Callable[[], Tensor], residual: Callable[[], Tensor]) -> Tensor:
        return spread(draws)


def cells_of(problem: Problem, models: Iterable[RewardModel], axes: Collection[Axis] = ()) -> Cells:
    """The cells that models look at together, and some other axes."""
    seen = {*axes, *(axis for model in models for axis in model.looks_at)}
    return Cells.over(seen, problem.window, problem.states, problem.actions)


class Experience:
    """Models that were started together, and the windows that they have seen.

    Args:
        problem: sizes. models: with the uncertainty `Given`, or another.
        axes: of the table, where that is over more than these models look at.
    """

    def __init__(self, problem: Problem, *models: RewardModel, axes: Collection[Axis] = ()) -> None:
        self.problem, self.models = problem, models
        self.places: Places = Table(problem, cells_of(problem, models, axes)) if problem.tabular else Rows(problem)
        for model in models:
            model.start(problem, self.places)
        self.store = Store(problem)

    def see(self, windows: Windows, weights: Tensor | None = None) -> Experience:
        """Append windows, with weights [R, k, 1+B]."""
        self.store.append(windows)
        self.places.extend(self.store)
        return self._observe(weights, False)

    def anew(self, windows: Windows, weights: Tensor) -> Experience:
        """Forget all windows, and fit these, with weights [R, K, 1+B]; only for tables."""
        self.store = Store(self.problem)
        self.store.append(windows)
        return self._observe(weights, True)

    def _observe(self, weights: Tensor | None, anew: bool) -> Experience:
        for model in self.models:
            if isinstance(model.uncertainty, Given):
                model.uncertainty.next, model.uncertainty.anew = weights, anew
            model.observe(self.store)
        return self


def part(windows: Windows, which: slice) -> Windows:
    """Some windows of those of one length."""
    s, a, n = (windows.grid(x)[:, which] for x in (windows.states, windows.actions, windows.next_states))
    return Windows.of_grid(s, a, n, windows.labels[:, which])


def of_replica(windows: Windows, replica: int) -> Windows:
    """The windows of one replica alone, of one length."""
    s, a, n = (x[replica : replica + 1] for x in (windows.states, windows.actions, windows.next_states))
    return Windows(s, a, n, labels=windows.labels[replica : replica + 1], length=windows.length)


def first(windows: Windows, count: int) -> Windows:
    """The first windows of each replica, of any lengths."""
    assert windows.last is not None
    rows = windows.last[:, count - 1] + 1 if count else torch.zeros(len(windows.last), dtype=torch.int64)
    most = int(rows.max())
    columns = ("states", "actions", "next_states", "step", "ended", "terminated", "primitive")
    cut = {name: None if (x := getattr(windows, name)) is None else x[:, :most] for name in columns}
    even = bool((rows == most).all())
    return replace(
        windows,
        **cut,
        labels=windows.labels[:, :count],
        last=windows.last[:, :count],
        count=None if even else rows,
    )


def poisson(windows: Windows, draws: int, seed: int = 1) -> Tensor:
    """Weights [R, K, 1+B]; those of the point fit are 1."""
    ones = torch.ones(*windows.labels.shape, 1 + draws, dtype=FLOAT)
    weights = torch.poisson(ones, generator=torch.Generator().manual_seed(seed))
    weights[..., 0] = 1
    return weights

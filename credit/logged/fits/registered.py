"""Registered reward models, fitted to windows of a table: predictions of the point fit and of every draw.

How a model's draws come about:

* its own uncertainty, where it was asked for: the draws of a bootstrap; or, of networks, their mean and deviation, from
  which draws are made that move all rows together (as a sum over rows needs, if errors of rows hang together);
* else, for models that take weights of windows, the weights that formulas have here: common draws;
* else refits to units that were drawn again, so many times as `weighing.times` says: each is a replica.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from credit.core.seams import RewardModel
from credit.core.signatures import component_kind, signature
from credit.core.store import Store
from credit.core.windows import Windows
from credit.logged.fits.mixture import PREDICTED
from credit.logged.fits.odds import intercept
from credit.logged.fits.predicting import RegisteredFit, Started
from credit.logged.fits.units import Units, exponential
from credit.logged.fits.weighing import Single, Weighed, times
from credit.logged.panel import Floats, Ints
from credit.logged.panel import Windows as Labelled
from credit.logged.steps import Spaces
from credit.recovery.recovery import places_of
from credit.recovery.uncertainty.bootstrap import Bootstrap, FitUncertainty

if TYPE_CHECKING:
    from credit.logged.registered import Registered

LARGEST = 200_000_000  # numbers of all rows
REPLICATED = 30_000_000  # numbers of rows in replicas that are fitted side by side
AT_ONCE = 2_000  # windows that are added to weighted fits together


@dataclass(frozen=True)
class Team:
    """The registered models of one recovery, and what they are fitted to.

    Args:
        models: each with its name. reference: that of the reference. spaces: how rows are steps. rows: their design
            [n, F]. windows: of the table. units, draws, seed: what draws weigh.
    """

    models: Sequence[Registered]
    reference: str
    spaces: Spaces
    rows: Floats
    windows: Labelled
    units: Units
    draws: int
    seed: int

    def fitted(self, known: np.ndarray, draws: int) -> dict[str, RegisteredFit]:
        """Fit to windows with a label [W], and tell so many draws."""
        found = {model.name: self._fit(model, known, draws) for model in self.models}
        if self.spaces.roles.label_is == "binary":
            for fit in found.values():
                fit.intercept = intercept(self._sums(fit)[known], self.windows.label[known])
        return found

    def _sums(self, fit: RegisteredFit) -> Floats:
        """What the point fit's rewards add up to in each window [W]."""
        parts = [fit(self.rows[first : first + PREDICTED])[0][:, 0] for first in range(0, len(self.rows), PREDICTED)]
        return np.add.reduceat(np.concatenate(parts), np.cumsum(self.windows.steps) - self.windows.steps)

    def _fit(self, one: Registered, known: np.ndarray, draws: int) -> RegisteredFit:
        model, own = copy.deepcopy(one.chosen.model), one.chosen.own
        kind = _wanted(model)
        reference = one.name == self.reference
        if own and model.uncertainty is not None:
            normal = None if isinstance(model.uncertainty, FitUncertainty) else self._normal()
            return RegisteredFit(self.spaces, [self._alone(model, known)], reference, normal, False, draws)
        if kind is not None and issubclass(Weighed, kind):
            model.uncertainty = Weighed(self.units.weights(self.units.of, draws, self.seed))
            return RegisteredFit(self.spaces, [self._alone(model, known)], reference, None, False, draws)
        if kind is not None and issubclass(Single, kind):
            model.uncertainty = Single()
        return RegisteredFit(self.spaces, [*self._replicas(model, known, draws)], reference, None, True, draws)

    def _normal(self) -> Floats:
        """Normal numbers of mean 0 and deviation 1, those of each draw the same for all models [B]."""
        from scipy.special import ndtri

        keys = np.array([0], dtype=np.uint64)
        found = ndtri(-np.expm1(-exponential(keys, self.draws, self.seed)[0]))
        return (found - found.mean()) / (found.std() or 1.0)

    def _alone(self, model: RewardModel, known: np.ndarray) -> Started:
        """Fit one replica to all windows; those that are added up come in parts."""
        chosen = np.arange(len(self.windows))
        problem, bare = self._problem(model, (self.seed,), bool(known.all())), copy.deepcopy(model)
        places = places_of([one.chosen.model for one in self.models], problem)
        model.start(problem, places)
        uncertainty = model.uncertainty
        poisson = isinstance(uncertainty, Bootstrap) and uncertainty.resample == "poisson"
        at_once = AT_ONCE if poisson or isinstance(uncertainty, Weighed) else len(chosen)
        store = Store(problem)
        for first in range(0, len(chosen), at_once):
            store.append(self._windows(model, [chosen[first : first + at_once]], known))
            places.extend(store)
            model.observe(store)
        return Started(model if problem.tabular else self._lean(bare, model, problem), places, problem)

    def _replicas(self, model: RewardModel, known: np.ndarray, draws: int) -> Iterator[Started]:
        """Fit a replica a draw to its windows, some replicas at a time."""
        labelled = np.flatnonzero(known)
        often = times(self.units, self.units.of[labelled], draws, self.seed)
        at_once = max(1, REPLICATED // max(self.rows.size, 1))
        for first in range(0, 1 + draws, at_once):
            count = min(at_once, 1 + draws - first)
            chosen = [np.repeat(labelled, often[:, first + at]) for at in range(count)]
            fresh, bare = copy.deepcopy(model), copy.deepcopy(model)
            seeds = tuple(self.seed + first + at for at in range(count))
            problem = self._problem(fresh, seeds, False)
            places, store = places_of([one.chosen.model for one in self.models], problem), Store(problem)
            fresh.start(problem, places)
            store.append(self._windows(fresh, chosen, known))
            places.extend(store)
            fresh.observe(store)
            yield Started(fresh if problem.tabular else self._lean(bare, fresh, problem), places, problem)

    def _lean(self, bare: RewardModel, fitted: RewardModel, problem: Any) -> RewardModel:
        """The same model, without the rows that it was fitted to."""
        bare.start(problem, places_of([one.chosen.model for one in self.models], problem))
        bare.load_state_dict(fitted.state_dict())
        return bare

    def _problem(self, model: RewardModel, seeds: tuple[int, ...], whole: bool) -> Any:
        return self.spaces.problem(seeds, 1 if self._reduced(model) else None, whole)

    def _reduced(self, model: RewardModel) -> bool:
        """Whether a window is its last row alone: a label is that row's, and the model does not say so itself."""
        return self.spaces.roles.label_is == "last" and getattr(model, "credit", "") != "last_step"

    def _windows(self, model: RewardModel, chosen: Sequence[Ints], known: np.ndarray) -> Windows:
        """Some windows for each replica [R] of numbers of windows, as the models know them."""
        steps, ends = self.windows.steps, np.cumsum(self.windows.steps)
        reduced = self._reduced(model)
        lengths = [np.ones(len(own), dtype=np.int64) if reduced else steps[own] for own in chosen]
        rows = [_ranges(ends[own] - count, count) for own, count in zip(chosen, lengths, strict=True)]
        most, windows = max(map(len, rows)), max(map(len, chosen))
        counts = [len(own) for own in rows]
        index, last = _padded(rows, most, "edge"), _padded([np.cumsum(own) - 1 for own in lengths], windows, "edge")
        scale = steps if self.spaces.roles.label_is == "mean" else 1  # a mean of rows, as the sum that models fit
        values = np.where(known, self.windows.label * scale, 0.0)
        labels, there = (_padded([column[own] for own in chosen], windows, "constant") for column in (values, known))
        every = self.spaces.steps(self.rows)
        ended = torch.zeros(index.shape, dtype=torch.bool).scatter(1, last, True)
        same = len(set(counts)) == 1
        even = len(chosen) == 1 and (reduced or self.spaces.even)
        return Windows(
            states=every.states[index], actions=every.actions[index], next_states=every.next_states[index],
            step=every.times[index] * (0 if reduced else 1), labels=labels, labelled=None if there.all() else there,
            length=int(lengths[0][0]) if even else None, last=None if even else last, ended=ended,
            terminated=torch.zeros_like(ended), count=None if same or even else torch.tensor(counts),
        )  # fmt: skip


def _padded(columns: Sequence[NDArray[Any]], length: int, mode: Literal["edge", "constant"]) -> Tensor:
    """Columns of several replicas side by side [R, length], with the last value behind their ends, or 0."""
    return torch.from_numpy(np.stack([np.pad(own, (0, length - len(own)), mode=mode) for own in columns]))


def _ranges(first: Ints, count: Ints) -> Ints:
    """All numbers from first to first + count − 1, of several ranges after each other."""
    starts = np.cumsum(count) - count
    return np.arange(int(count.sum())) + np.repeat(first - starts, count)


def _wanted(model: RewardModel) -> type | None:
    """The kind of uncertainty that a model takes, where it takes one."""
    hint = signature(type(model)).get("uncertainty")
    return None if hint is None else component_kind(hint[0])

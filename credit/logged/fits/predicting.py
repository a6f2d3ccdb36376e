"""What a registered reward model that was fitted predicts of rows, in its point fit and in every draw; and how it is
kept: plain values and arrays, of which nothing runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from credit.core.acting import laid_over
from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Places, RewardModel
from credit.core.steps import Steps
from credit.logged.fits.states import joined, split
from credit.logged.fits.weighing import Single, Weighed
from credit.logged.panel import Floats
from credit.logged.steps import Spaces
from credit.recovery.places import Rows, Table

PROBES = 16  # rows by which it is seen that a model which was read predicts what it did
ALIKE = 1e-3  # of the largest prediction: what processors and versions may do to single precision

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Started:
    """A model of some replicas.

    Attributes:
        model: fitted. places: where its pseudo-reward is defined. problem: for which it was started.
    """

    model: RewardModel
    places: Places
    problem: Problem

    def saved(self, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
        """Plain values; what predictions look at goes to `arrays`."""
        uncertainty, visits, cells = self.model.uncertainty, self.places.visits, self.places.cells
        return {
            "seeds": list(self.problem.seeds),
            "window": self.problem.window,
            "even": self.problem.even,
            "axes": None if cells is None else list(cells.axes),
            "weighed": uncertainty.draws if isinstance(uncertainty, Weighed) else None,
            "single": isinstance(uncertainty, Single),
            "state": split(self.model.acting(), arrays),
            "visits": split(visits, arrays),
        }

    @classmethod
    def read(cls, plain: Mapping[str, Any], arrays: Arrays, model: RewardModel, spaces: Spaces) -> Started:
        """What was saved, of a model that is not started."""
        found = spaces.problem(tuple(plain["seeds"]), int(plain["window"]))
        problem = replace(found, even=bool(plain["even"]))
        if plain["weighed"] is not None:  # by weights that no prediction needs
            model.uncertainty = Weighed(np.ones((1, 1 + int(plain["weighed"]))))
        elif plain["single"]:
            model.uncertainty = Single()
        places: Places = Rows(problem)
        if problem.tabular:
            cells = Cells.over(plain["axes"], problem.horizon, problem.states, problem.actions)
            table = Table(problem, cells)
            table.visits.copy_(joined(plain["visits"], arrays))
            places = table
        model.start(problem, places)
        model.load_state_dict(laid_over(model.state_dict(), joined(plain["state"], arrays)))
        return cls(model, places, problem)


class RegisteredFit:
    """A model that was fitted.

    Args:
        spaces: how rows are steps. models: one, or several of some replicas each. reference: whether it is the
            reference, whose variance has a prior where nothing was seen. normal: of draws, where the model has a mean
            and a deviation alone [B]. replicas: whether replicas are the draws.
        draws: how many are told.
    """

    def __init__(
        self,
        spaces: Spaces,
        models: Sequence[Started],
        reference: bool,
        normal: Floats | None,
        replicas: bool,
        draws: int,
    ) -> None:
        self._spaces, self._models, self._reference = spaces, models, reference
        self._normal, self._replicas, self.draws = normal, replicas, draws
        self.intercept = 0.0  # of windows' log-odds, where labels are bits

    def __len__(self) -> int:
        """1 + B."""
        return 1 + self.draws

    @torch.no_grad()
    def __call__(self, design: Floats) -> tuple[Floats, Floats]:
        """What all fits predict of rows [n, F], the point first [n, 1 + B]; and by how much the model's variance is
        larger than that of the draws [n]."""
        steps = self._steps(design)
        if self._replicas:
            means = [one.model.believe(steps).mean for one in self._models]
            return np.ascontiguousarray(_numbers(torch.cat(means)).T), np.zeros(len(design))
        model, places = self._models[0].model, self._models[0].places
        found = model.believe(steps)
        mean, variance = _numbers(found.mean[0]), _numbers(found.variance[0])
        if self._normal is None:
            assert found.draws is not None
            draws = _numbers(found.draws[0, : self.draws]).T
        else:
            draws = mean[:, None] + np.sqrt(np.maximum(variance, 0))[:, None] * self._normal[: self.draws]
        beyond = variance - draws.var(1)
        if self._reference and places.visits is not None and places.cells is not None:
            seen = places.visits.gather(1, places.cells.index(steps)[None])
            beyond = beyond + _numbers(torch.as_tensor(model.prior(seen)).expand(seen.shape)[0])
        return np.concatenate([mean[:, None], draws], axis=1), beyond

    def _steps(self, design: Floats) -> Steps:
        """Rows as the models saw them: where windows were their last rows alone, all are the first of one.

        Raises:
            UserError: a model looks at the step in a window, and these are longer than those that were fitted.
        """
        steps, window, cells = self._spaces.steps(design), self._models[0].problem.window, self._models[0].places.cells
        if window == 1 and self._spaces.roles.label_is == "last":
            return replace(steps, step=torch.zeros_like(steps.times))
        if cells is not None and "step" in cells.axes and len(design) and (last := int(steps.times.max())) >= window:
            raise UserError(
                f"a window has {last + 1} rows, and {window} at most when the model was fitted, which looks at the "
                "step in a window; score windows that are as long, or recover with models of states and actions"
            )
        return steps

    def saved(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Plain values and arrays.

        Raises:
            UserError: a model's state cannot be saved.
        """
        arrays = dict[str, np.ndarray]()
        models = [one.saved(arrays) for one in self._models]
        if self._normal is not None:
            arrays["normal"] = self._normal
        probe = probed(self._spaces)
        arrays["probe"], (arrays["answers"], arrays["beyond"]) = probe, self(probe)
        plain = {
            "models": models,
            "reference": self._reference,
            "replicas": self._replicas,
            "draws": self.draws,
            "intercept": self.intercept,
        }
        return plain, arrays

    @classmethod
    def read(
        cls, plain: Mapping[str, Any], arrays: Arrays, fresh: Callable[[], RewardModel], spaces: Spaces
    ) -> RegisteredFit:
        """What was saved.

        Args:
            fresh: gives the model, not started. spaces: how rows are steps.

        Raises:
            ValueError: it does not predict what it did; and whatever a state of something else raises.
        """
        models = [Started.read(one, arrays, fresh(), spaces) for one in plain["models"]]
        normal = arrays.get("normal")
        found = cls(spaces, models, bool(plain["reference"]), normal, bool(plain["replicas"]), int(plain["draws"]))
        found.intercept = float(plain["intercept"])
        if arrays["answers"].shape[1] != len(found):
            raise ValueError(f"it has {arrays['answers'].shape[1]} fits, not {len(found)}")
        for now, then in zip(found(arrays["probe"]), (arrays["answers"], arrays["beyond"]), strict=True):
            if now.shape != then.shape or not (np.abs(now - then) <= ALIKE * np.abs(then).max(initial=1e-12)).all():
                raise ValueError("it does not predict what it did when it was saved")
        return found


def _numbers(values: Tensor) -> Floats:
    return values.to(torch.float64).numpy()


def probed(spaces: Spaces, count: int = PROBES) -> Floats:
    """The design of rows within what columns are [n, F], as no table needs to have them."""
    number = np.arange(count)
    if spaces.sizes is not None:
        state, action = number % spaces.sizes[0], number % spaces.sizes[1]
        return np.stack([state, action, state, np.zeros(count)], axis=1).astype(np.float64)
    roles, columns = spaces.roles, spaces.columns
    blocks: list[Any] = [np.zeros((count, 0))]
    for at, name in enumerate((*roles.states, *roles.actions)):
        column, share = columns[name], (number * 0.618 + 0.3 * at) % 1  # spread evenly
        if column.levels is not None:
            blocks.append((np.arange(len(column.levels)) == (number % len(column.levels))[:, None]).astype(np.float64))
        else:
            low, high = (column.least, column.most) if name in roles.states else (-1.0, 1.0)
            blocks.append((low + share * (high - low))[:, None])
    here = np.concatenate(blocks, axis=1)
    return np.concatenate([here, here[:, : spaces.widths[0]], np.zeros((count, 1))], axis=1)

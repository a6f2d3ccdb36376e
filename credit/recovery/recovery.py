"""Reference + surrogates → MSE proxies → mixture → bonus: the paper on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import ClassVar

import torch
from torch import Tensor

from credit.core.dataset import Dataset
from credit.core.errors import UserError
from credit.core.interfaces import Bonus, Mixer, RewardModel
from credit.core.tables import CellModel, CellUncertainty, RewardFunction
from credit.core.types import Problem, Recovery, Windows
from credit.recovery.alike import Alike, spread
from credit.recovery.mixers import best_model, mix


class RewardRecovery(RewardFunction):
    """Learn a pseudo-reward for every cell from labels (sections 3.2–4.3, algorithm B.1 lines 3–16).

    Args:
        reference: the flexible model.
        surrogates: name → structured model; may be empty.
        uncertainty: how draws and variances are made.
        mixer: MSE proxies → weights.
        bonus: name → what optimism adds; their sum is the bonus.
    """

    domain: ClassVar = "tabular"
    keeps: ClassVar = ("models", "uncertainty", "mixer", "bonus", "_visits")

    def __init__(
        self,
        reference: CellModel,
        surrogates: Mapping[str, CellModel],
        uncertainty: CellUncertainty,
        mixer: Mixer,
        bonus: Mapping[str, Bonus],
    ) -> None:
        self.models = [reference, *surrogates.values()]
        self.uncertainty = uncertainty
        self.mixer = mixer
        self.bonus = dict(bonus)
        self.names = names_of(self.models)

    def start(self, problem: Problem) -> None:
        """Empty models, no visits."""
        problem = replace(problem, axes=tuple({axis for model in self.models for axis in model.looks_at}))
        if "step" in problem.axes and not problem.episodic:
            raise UserError(
                "a reward model looks at the step in the window, and windows follow each other here: the step means "
                "nothing; use models that look at states and actions alone, or an environment with episodes"
            )
        self._cells = problem.cells
        self.uncertainty.start(problem)
        for model in self.models:
            model.start(problem, self.uncertainty.draws)
        for bonus in self.bonus.values():
            bonus.start(problem)
        self._visits = problem.zeros(problem.cells.count)
        self._alike = Alike([model.looks(problem) for model in self.models])
        self._recovery = self._recover(Dataset(problem, 0))

    def observe(self, dataset: Dataset) -> None:
        """Count visits, refit every model with the newest windows, and recover the reward anew."""
        cells = self._cells.index(dataset.new).flatten(1)
        self._visits.scatter_add_(1, cells, torch.ones_like(cells, dtype=self._visits.dtype))
        self.uncertainty.observe(self.models, dataset)
        self._recovery = self._recover(dataset)

    def recovery(self) -> Recovery:
        """What is believed since the last windows."""
        return self._recovery

    def rewards(self, windows: Windows) -> Tensor:
        """r_plan of every step [R, K, T]."""
        cells = self._cells.index(windows)
        return self._recovery.plan.gather(1, cells.flatten(1)).view(cells.shape)

    def _recover(self, dataset: Dataset) -> Recovery:
        cells, column = None, None
        if self._alike.saves and self.uncertainty.draws:
            cells, column = self._alike.choose(self._visits)
        reference, *surrogates = [model.estimate(cells) for model in self.models]
        visits = self._visits if cells is None else self._visits.gather(1, cells)
        gaps = [self.uncertainty.disagreement(reference, surrogate) for surrogate in surrogates]
        excess = [self.uncertainty.prior(visits), *gaps]
        proxies = [
            self.uncertainty.variance(model, estimate) + more
            for model, estimate, more in zip(self.models, [reference, *surrogates], excess, strict=True)
        ]
        mse = torch.stack(proxies, dim=1)
        errors = None
        if self.mixer.sees_label_errors:
            steps = self._cells.index(dataset.windows)
            columns = steps if column is None else column.gather(1, steps.flatten(1)).view(steps.shape)
            errors = self.uncertainty.label_errors([reference, *surrogates], dataset, columns)
        weights = self.mixer.weights(mse, errors)
        mean = torch.stack([reference.mean, *(surrogate.mean for surrogate in surrogates)], dim=1)
        disagreement = torch.stack(gaps, dim=1) if gaps else mse[:, :0]
        if column is not None:
            mean, mse, disagreement, weights = (spread(part, column) for part in (mean, mse, disagreement, weights))
        mixed = mix(weights, mean)
        recovery = Recovery(
            models=self.names,
            mean=mean,
            draws=(reference.draws, *(surrogate.draws for surrogate in surrogates)),
            mse=mse,
            disagreement=disagreement,
            weights=weights,
            best=best_model(mse),
            mixed=mixed,
            bonus={},
            plan=mixed,
            visits=self._visits.clone(),
            cells=self._cells,
            column=column,
        )
        bonus = {name: term(recovery, self.models[0]) for name, term in self.bonus.items()}
        return replace(recovery, bonus=bonus, plan=reduce(torch.add, bonus.values(), mixed))


def names_of(models: Sequence[RewardModel]) -> tuple[str, ...]:
    """The names of reward models, which must differ.

    Raises:
        UserError: two have the same.
    """
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        raise UserError(f"reward models need different names: {names}; change one `name`")
    return tuple(names)

"""Recovery where states and actions are real numbers: the same equations, a row a step (4.2, 4.4, algorithm B.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from typing import ClassVar

import torch
from torch import Tensor

from credit.continuous import ContinuousProblem, Moves, Scaler, StepBelief, StepModel, Trajectories
from credit.interfaces import Bonus, CreditAssigner, Mixer
from credit.mixers import best_model, mix
from credit.recovery import names_of
from credit.tensors import grown
from credit.trajectories import TrajectoryDataset


class StepRecovery(CreditAssigner):
    """Learn a pseudo-reward for every step from trajectories' labels (B.2 lines 4–12).

    Args:
        reference: the flexible model.
        surrogates: name → structured model; may be empty.
        mixer: MSE proxies → weights.
        bonus: name → what optimism adds; their sum is the bonus.
        scaler: how the sum of both is scaled for the policy optimizer; nothing is done without one.
    """

    domain: ClassVar = "continuous"
    needs: ClassVar = {"reference": StepModel, "surrogates": StepModel}
    keeps: ClassVar = ("models", "mixer", "bonus", "scaler", "_inputs", "_rows")

    def __init__(
        self,
        reference: StepModel,
        surrogates: Mapping[str, StepModel],
        mixer: Mixer,
        bonus: Mapping[str, Bonus],
        scaler: Scaler | None = None,
    ) -> None:
        self.models = [reference, *surrogates.values()]
        self.mixer = mixer
        self.bonus = dict(bonus)
        self.scaler = scaler
        self.names = names_of(self.models)

    def start(self, problem: ContinuousProblem) -> None:
        """Empty models, no rows."""
        self._replicas = problem.replicas
        for model in self.models:
            model.start(problem)
        for bonus in self.bonus.values():
            bonus.start(problem)
        self._inputs: list[Tensor] = []  # of each model: φ of all rows so far, with room for more
        self._rows = 0

    def observe(self, dataset: TrajectoryDataset) -> None:
        """Fit every model to all labels, and recover the reward of every step anew."""
        windows = dataset.windows
        self._extend(dataset.new)
        inputs = [block[: self._rows] for block in self._inputs]
        for model, rows in zip(self.models, inputs, strict=True):
            model.fit(rows, windows)
        self._recovery = self._believe(inputs, windows)
        plan = self._recovery.plan[0]
        self._rewards = plan if self.scaler is None else self._scaled(self.scaler, plan, windows)

    def recovery(self) -> StepBelief:
        """What is believed of all steps so far, [1, ..., N] with the rows of all replicas as N."""
        return self._recovery

    def believe(self, moves: Moves) -> StepBelief:
        """What is believed of other steps, [1, ..., N]: a grid to look at."""
        return self._believe([model.features(moves) for model in self.models], moves)

    def rewards(self, windows: Trajectories) -> Tensor:
        """The scaled pseudo-reward [N] of every step."""
        if len(windows) != self._rows:
            raise ValueError(f"rewards of {len(windows)} steps are asked for, and {self._rows} were seen")
        return self._rewards

    def _extend(self, new: Trajectories) -> None:
        """φ of the newest rows is computed once, here."""
        start, self._rows = self._rows, self._rows + len(new)
        for index, model in enumerate(self.models):
            values = model.features(new)
            if not start:
                self._inputs.append(values.new_empty(1, *values.shape[1:]))
            block = self._inputs[index]
            if self._rows > len(block):
                block = self._inputs[index] = grown(block.unsqueeze(0), self._rows)[0]
            block[start : self._rows] = values

    def _believe(self, inputs: list[Tensor], moves: Moves) -> StepBelief:
        predicted = [model.predict(rows, moves) for model, rows in zip(self.models, inputs, strict=True)]
        mean, variance = (torch.stack(parts).unsqueeze(0) for parts in zip(*predicted, strict=True))  # [1, M, N]
        disagreement = (mean[:, :1] - mean[:, 1:]).square()
        mse = torch.cat([variance[:, :1], variance[:, 1:] + disagreement], dim=1)  # (10), (11)
        weights = self.mixer.weights(mse)
        mixed = mix(weights, mean)
        recovery = StepBelief(
            models=self.names,
            mean=mean,
            draws=(),
            mse=mse,
            disagreement=disagreement,
            weights=weights,
            best=best_model(mse),
            mixed=mixed,
            bonus={},
            plan=mixed,
            replica=moves.replica,
        )
        bonus = {name: term(recovery, self.models[0]) for name, term in self.bonus.items()}
        return replace(recovery, bonus=bonus, plan=reduce(torch.add, bonus.values(), mixed))

    def _scaled(self, scaler: Scaler, plan: Tensor, moves: Moves) -> Tensor:
        """The scaled plan [N]; a replica's scale is its own."""
        scaled = torch.empty_like(plan)
        for replica in range(self._replicas):
            own = moves.replica == replica
            scaled[own] = scaler(plan[own])
        return scaled

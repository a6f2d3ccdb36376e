"""The neural estimator: a network of single steps, fitted to the labels of whole trajectories (5)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.cells import Axis
from credit.core.checks import require_finite
from credit.core.problem import Problem
from credit.core.ranges import Name, NonNegative, Positive, PositiveInt
from credit.core.seams import FeatureMap, Likelihood, Places, RewardModel
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.streams import side_by_side
from credit.core.tensors import CACHED
from credit.core.windows import Windows
from credit.networks.adam import Adam
from credit.networks.beside import Modules
from credit.networks.denormals import flushed
from credit.networks.modules import Network
from credit.networks.stack import Shape, Stack
from credit.recovery.models.batches import Balance, balanced, every, padding
from credit.recovery.models.intercepts import Intercepts
from credit.recovery.models.logistic import check_bits, curvature, require_bits
from credit.recovery.models.units import Units
from credit.recovery.uncertainty.networks import NetworkUncertainty

MOST = 64  # steps of a window that are fitted, where nobody says how many
TINY = 1e-6  # a feature with a smaller deviation is a constant, and is not scaled


class NeuralModel(RewardModel):
    """A perceptron on a feature map, output / H, fitted to window labels by Adam (5).

    Minimised is the mean over trajectories of (Y − Σ_t r̃)² + λ Σ_t |r̃|, in batches of which half have the better
    labels, on every stride-th step. On the motion of a body it is the DNN reference, on three features of a maze the
    heuristic surrogate. R × E networks lie side by side; each goes on from its last fit.

    Args:
        name: the model's name in metrics, files and figures.
        features: the feature map φ.
        uncertainty: what is trained, and how it predicts: mean and variance.
        width: of the hidden layers. depth: how many there are.
        network: what makes other networks than perceptrons, of which neither width nor depth then speaks; they learn by
            autograd, and uncertainty=ensemble alone takes them.
        sparsity: λ, on the sum of |r̃| over a trajectory.
        first_steps: gradient steps of the first fit. steps: of each later one.
        batch: B, trajectories a gradient step. stride: one step in so many is fitted, and stands for the others; None:
            as many as leave at most 64 of a window.
        learning_rate: Adam's.
        balance: what the two halves of a batch are: `bits`, successes and failures; `quantiles`, the upper and the
            lower half of the labels; `auto`, bits where labels take at most two values, else quantiles; `none`, all.
        standardise: whether labels are seen in units of their own deviation, less their mean a step (`Units`); not
            where they are bits with log-odds, which have no unit.
        likelihood: of labels: gaussian, as above, or logistic, of bits whose log-odds the sum is (`models.logistic`).
    """

    uncertainty: NetworkUncertainty
    keeps: ClassVar = ("networks", "_batches", "_adam", "_posterior", "_mean", "_scale", "_units", "_fits")

    def __init__(
        self,
        name: Name,
        features: FeatureMap,
        uncertainty: NetworkUncertainty,
        width: PositiveInt = 64,
        depth: PositiveInt = 2,
        sparsity: NonNegative = 0.01,
        first_steps: PositiveInt = 600,
        steps: PositiveInt = 100,
        batch: PositiveInt = 32,
        stride: PositiveInt | None = 12,
        learning_rate: Positive = 1e-3,
        balance: Balance = "auto",
        standardise: bool = False,
        likelihood: Likelihood = "gaussian",
        network: Network | None = None,
    ) -> None:
        self.name = name
        self.features = features
        self.uncertainty = uncertainty
        self.width, self.depth = width, depth
        self.sparsity = sparsity
        self.first_steps, self.steps = first_steps, steps
        self.batch, self.stride = batch, stride
        self.learning_rate = learning_rate
        self.balance = balance
        self.standardise = standardise
        self.likelihood = likelihood
        self.network = network

    @property
    def looks_at(self) -> Collection[Axis]:  # type: ignore[override]
        """What the features read."""
        return self.features.looks_at

    def start(self, problem: Problem, places: Places) -> None:
        """Fresh networks.

        Raises:
            UserError: logistic, where labels are no bits.
        """
        logistic = self.likelihood == "logistic"
        if logistic:
            require_bits(self.name, problem)
        self._problem, self._device, self._places = problem, problem.device, places
        self.features.start(problem)
        self._look = places.look(self.features)
        inputs, members = self.features(problem.blank()).shape[-1], self.uncertainty.members
        self._owner = torch.arange(problem.replicas, device=problem.device).repeat_interleave(members)
        weights = side_by_side(problem.seeds, f"{self.name}/weights", members)
        self.networks: Stack | Modules
        if self.network is None:
            self.networks = Stack.drawn(Shape(inputs, 1, self.width, self.depth), weights, problem.device)
        else:
            self.networks = Modules(self.network, inputs, weights, problem.device)
        self._batches = side_by_side(problem.seeds, f"{self.name}/batches", members)
        self._stride = self.stride or max(1, problem.window // MOST)
        self._passes = self.networks.passes(self.batch * padding(self._stride, problem.window))
        self._adam = Adam(self.networks.flat, self._passes.gradient, self.learning_rate)
        self._units = Units(problem, self.standardise and not logistic)
        self._odds = Intercepts(len(self._owner), self.learning_rate, problem.device) if logistic else None
        self._posterior = self.uncertainty.posterior(self.networks, problem, self.name)
        self._mean = torch.zeros(problem.replicas, inputs, device=problem.device)
        self._scale = torch.ones_like(self._mean)
        self._fits = 0

    def remark(self) -> str:
        """Whether networks learn one after the other."""
        if isinstance(self.networks, Modules) and self.networks.loops:
            return f"{self.name}.network: torch.func does not carry this module, and networks learn one after the other"
        return ""

    def _names(self) -> tuple[str, ...]:
        return (*super()._names(), *(() if self._odds is None else ("_odds",)))

    @torch.no_grad()
    def observe(self, store: Store) -> None:
        """Some gradient steps on all windows so far.

        Raises:
            RunError: a weight is not finite.
        """
        windows = store.windows
        self.fit(self._look.rows(windows, newest=False), windows)

    @torch.no_grad()
    def fit(self, inputs: Tensor, windows: Windows) -> None:
        """Some gradient steps on windows whose rows look like `inputs` [R, n, d].

        Raises:
            RunError: a weight is not finite.
        """
        if not len(windows):
            return
        if self._odds is not None:
            check_bits(self.name, windows)
        if not self._fits:
            self._standardise(inputs, windows)
        self._units.look(windows)
        steps = every(windows, self._stride, self._problem.window)
        replica = torch.arange(len(inputs), device=inputs.device).view(-1, 1, 1)
        rows = inputs[replica, steps.rows].float()
        rows = rows.sub_(self._mean[:, None, None]).mul_(self._scale[:, None, None])[self._owner]
        shares, labels = (steps.weights / self._problem.window)[self._owner], self._units.scaled(windows)[self._owner]
        labelled = None if windows.labelled is None else windows.labelled[self._owner]
        if labelled is not None:  # what has no label is no evidence, and a replica without any has nothing to learn
            shares = shares * labelled.unsqueeze(-1)
        self._descend(rows, shares, labels, labelled, self.steps if self._fits else self.first_steps)
        self._fits += 1
        self._check()
        self._posterior.fitted(rows, shares, self._curvature(rows, shares))

    def estimate(self, at: Tensor | None = None) -> Estimate:
        """Mean and variance of some places [R, n], or of all."""
        return self._predict(self._look.places(at), self._places.counts if at is None else None)

    def believe(self, steps: Steps) -> Estimate:
        """Mean and variance of other steps [n]."""
        return self._predict(self.features(steps), None)

    @torch.no_grad()
    def _predict(self, inputs: Tensor, counts: Sequence[int] | None) -> Estimate:
        """Mean and variance [R, n] of φ [R, n, d] or [n, d], in parts that stay in the cache; 0 behind the counts."""
        horizon, size, replicas = self._problem.window, max(1, CACHED // (4 * self.width)), self._problem.replicas
        inputs = inputs.expand(replicas, *inputs.shape[-2:])
        mean, variance = (torch.zeros(inputs.shape[:2], device=inputs.device) for _ in range(2))
        for replica in range(replicas):
            predictor, first = self._posterior.predictor(replica), 0
            for rows in inputs[replica, : counts[replica] if counts else None].split(size):
                values = rows.to(torch.float32, copy=True).sub_(self._mean[replica]).mul_(self._scale[replica])
                own = replica, slice(first, first + len(rows))
                mean[own], variance[own] = predictor(values)
                first += len(rows)
        return Estimate(*self._units.rewards(mean.div_(horizon), variance.div_(horizon**2)))

    def _standardise(self, inputs: Tensor, windows: Windows) -> None:
        """Mean zero and deviation one for what is there at the first fit; so it stays."""
        counts = [len(windows)] * len(inputs) if windows.count is None else windows.count.tolist()
        for replica, count in enumerate(counts):
            own = inputs[replica, :count].double()
            deviation = own.std(0, correction=0)
            self._mean[replica] = own.mean(0)
            self._scale[replica] = torch.where(deviation > TINY, deviation, 1.0).reciprocal()

    @flushed()
    def _descend(self, rows: Tensor, shares: Tensor, labels: Tensor, labelled: Tensor | None, count: int) -> None:
        """Gradient steps on inputs [M, K, P, d], of which each has a share [M, K, P] in the label [M, K]."""
        members, trajectories, steps, size = rows.shape
        uniform = np.stack([g.random((count, self.batch)) for g in self._batches])
        first = trajectories * torch.arange(members, device=self._device).view(-1, 1, 1)
        chances = torch.from_numpy(uniform).to(self._device)
        drawn = (balanced(labels, chances, self.balance, labelled) + first).unbind(1)
        if self._odds is not None:
            self._odds.look(labels, labelled, self.batch, self.balance)
        offset = self._posterior.offset(rows.view(members, -1, size))
        rows, shares, labels = rows.view(-1, steps * size), shares.view(-1, steps), labels.flatten()
        offset = None if offset is None else offset.reshape(-1, steps)
        passes = self._passes
        for batch in drawn:
            chosen = batch.flatten()
            torch.index_select(rows, 0, chosen, out=passes.input.view(-1, steps * size))
            outputs = passes.forward(self._posterior.masks(passes.input.shape[1])).view(-1, steps)
            if offset is not None:
                outputs = outputs + offset[chosen]
            if self._odds is None:
                delta = gradient(outputs, shares[chosen], labels[chosen], self.sparsity)
            else:
                delta, by_odds = log_gradient(
                    outputs, shares[chosen], labels[chosen], self._odds.of(chosen // trajectories), self.sparsity
                )
                self._odds.step(by_odds.view(members, -1).mean(1))
            passes.backward(delta.div_(self.batch).view(members, -1, 1))
            self._adam.step()

    def _curvature(self, rows: Tensor, shares: Tensor) -> Tensor | None:
        """Of each window's likelihood by its log-odds [M, K]; None where labels are Gaussian."""
        if self._odds is None:
            return None
        outputs = torch.stack([self.networks.alone(m, own.flatten(0, 1)) for m, own in enumerate(rows)])
        if (offset := self._posterior.offset(rows.flatten(1, 2))) is not None:
            outputs = outputs + offset
        return curvature((outputs.view(shares.shape) * shares).sum(-1) + self._odds.values.unsqueeze(-1))

    def _check(self) -> None:
        """Raise RunError, with the model and its seeds, if a weight is not finite."""
        after = f" after fit {self._fits}; are labels and states finite? else try a smaller learning_rate"
        what = f"reward model {self.name!r}: a weight"
        require_finite(what, self.networks.blocks, self._problem.seeds, after)


def gradient(outputs: Tensor, shares: Tensor, labels: Tensor, sparsity: float) -> Tensor:
    """Of each trajectory's (Y − Σ_p w_p o_p)² + λ Σ_p w_p |o_p| (5), by the outputs o [B, P]; w are the shares."""
    residual = (outputs * shares).sum(-1, keepdim=True) - labels.unsqueeze(-1)
    return (2 * residual + sparsity * outputs.sign()).mul_(shares)


def log_gradient(
    outputs: Tensor, shares: Tensor, labels: Tensor, odds: Tensor, sparsity: float
) -> tuple[Tensor, Tensor]:
    """Of each trajectory's log(1 + e^z) − Y z + λ Σ_p w_p |o_p| with z = Σ_p w_p o_p + b (`models.logistic`).

    Returns:
        By the outputs o [B, P], and by b [B].
    """
    z = (outputs * shares).sum(-1) + odds
    error = z.sigmoid() - labels
    return (error.unsqueeze(-1) + sparsity * outputs.sign()).mul_(shares), error

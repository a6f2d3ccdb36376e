"""How far a neural reward model can be trusted: dropped units, several networks, or the last layer's posterior."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar

import numpy as np
import torch
from annotated_types import Interval
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.ranges import Positive
from credit.core.seams import Uncertainty
from credit.core.state import Stateful
from credit.core.streams import generators, side_by_side
from credit.networks.beside import Modules
from credit.networks.stack import Layer, Stack, hidden, output

Predictor = Callable[[Tensor], tuple[Tensor, Tensor]]
Networks = Stack | Modules
LEVELS = 2**16  # of a random number that decides whether a unit is kept: two bytes are drawn twice as fast as a float


class Posterior(Stateful, ABC):
    """What the M networks of one neural model believe together; it decides what is trained, and how it predicts.

    Inputs are the networks' [M, rows, d], standardised; outputs are theirs too, before the model scales them.
    Networks are numbered replica by replica: those of replica r are r·E … r·E + E − 1.
    """

    def masks(self, rows: int) -> Sequence[Tensor]:
        """For one training step: what is kept of every hidden layer, zeros and ones [M, rows, width]; () for all."""
        return ()

    def offset(self, inputs: Tensor) -> Tensor | None:
        """What is added to the outputs in training [M, rows], if anything is; it stays as it is."""
        return None

    def fitted(self, inputs: Tensor, shares: Tensor, curvature: Tensor | None = None) -> None:
        """Take note that the networks were fitted to sums of outputs.

        Args:
            inputs: those of K windows [M, K, P, d]. shares: the weight of every output in its sum [M, K, P].
            curvature: of the labels' likelihood by their sums [M, K]; None where it is Gaussian.
        """

    @abstractmethod
    def predictor(self, replica: int) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
        """The prediction of one replica, with random numbers of its own: rows [n, d] → mean and variance [n]."""


class NetworkUncertainty(Uncertainty):
    """How far a neural reward model can be trusted. One component serves several models: each has a posterior.

    Attributes:
        members: E, networks that are trained for a replica.
    """

    members: int = 1

    @abstractmethod
    def posterior(self, networks: Networks, problem: Problem, name: str) -> Posterior:
        """The posterior of a model of some name, on its R·E networks.

        Raises:
            UserError: it looks into perceptrons, and these are other modules.
        """


class Dropout(NetworkUncertainty):
    """MC dropout, as in the paper (4.1): mean and variance over some passes, each with other units dropped.

    A pass is one thinned network for all rows, drawn anew after every fit. That has the same mean and variance as
    masks of their own for every row, without the cost of drawing those; and a pass is a function of the state.
    What is kept is not scaled up: networks are trained with dropped units, and predict with dropped units.

    Args:
        passes: thinned networks a prediction.
        rate: probability that a hidden unit is dropped, in training and in prediction.
    """

    def __init__(
        self,
        passes: Annotated[int, Interval(ge=2)] = 8,
        rate: Annotated[float, Interval(gt=0, lt=1)] = 0.1,
    ) -> None:
        self.passes, self.rate = passes, rate

    def posterior(self, networks: Networks, problem: Problem, name: str) -> Posterior:
        """Thinned networks of a model."""
        return Thinned(perceptrons(networks, name, "dropout"), problem, name, self.passes, self.rate)


class Ensemble(NetworkUncertainty):
    """Networks that differ in their first weights, their batches and a random prior function each (Osband 2018).

    A network is trained so that its output *and* that of a second one, whose random weights stay as they are, fit the
    labels together: where there are no labels the sums differ as the priors do.

    Args:
        members: networks a model and replica. Their cost grows with them.
        prior_scale: factor of the second network's output; an output of 1 at all H steps is a label of 1.
    """

    def __init__(self, members: Annotated[int, Interval(ge=2)] = 5, prior_scale: Positive = 3.0) -> None:
        self.members, self.prior_scale = members, prior_scale

    def posterior(self, networks: Networks, problem: Problem, name: str) -> Posterior:
        """Networks with prior functions."""
        return WithPriors(networks, problem, name, self.members, self.prior_scale)


class LastLayer(NetworkUncertainty):
    """The posterior of ridge regression on the last hidden layer: φᵀΣφ with Σ = (ΦᵀΦ/σ² + I/α)⁻¹.

    φ are a step's last hidden units and a 1, Φ_i their sum over a trajectory as the label sees it. The neural form of
    the tabular reference's variance, for one network a model.

    Args:
        noise: σ, deviation of a label from the sum of rewards.
        prior_variance: α, of a weight of the last layer.
    """

    def __init__(self, noise: Positive = 0.3, prior_variance: Positive = 1.0) -> None:
        self.noise, self.prior_variance = noise, prior_variance

    def posterior(self, networks: Networks, problem: Problem, name: str) -> Posterior:
        """Last layers of a model's networks."""
        return LastLayers(perceptrons(networks, name, "last_layer"), self.noise, self.prior_variance)


class Thinned(Posterior):
    """Networks of which every hidden unit is dropped with some probability."""

    keeps: ClassVar = ("_training", "_prediction", "_kept")

    def __init__(self, networks: Stack, problem: Problem, name: str, passes: int, rate: float) -> None:
        self._networks, self._passes, self._rate = networks, passes, rate
        self._training = generators(problem.seeds, f"{name}/dropout in training")
        self._prediction = generators(problem.seeds, f"{name}/dropout in prediction")
        self._thin()

    def masks(self, rows: int) -> Sequence[Tensor]:
        """Fresh masks for every row."""
        shape, device = (self._networks.shape.depth, rows, self._networks.shape.width), self._networks.flat.device
        drawn = [_kept(g, shape, self._rate) for g in self._training]
        return torch.from_numpy(np.stack(drawn, 1)).to(device).unbind()

    def fitted(self, inputs: Tensor, shares: Tensor, curvature: Tensor | None = None) -> None:
        """Thin the networks anew: until the next fit, whoever looks sees the same."""
        self._thin()

    def predictor(self, replica: int) -> Predictor:
        """Mean and variance over thinned networks, which share the work of the first layer."""
        layers = self._networks.member(replica)
        passes = [
            [Layer(layer.weight * mask, *layer[1:]) for layer, mask in zip(layers[1:], masks, strict=True)]
            for masks in self._kept[replica]
        ]

        def predict(rows: Tensor) -> tuple[Tensor, Tensor]:
            first = hidden(rows, layers[:1])
            return moments(torch.stack([output(hidden(first, rest[:-1]), rest[-1]) for rest in passes]))

        return predict

    def _thin(self) -> None:
        """What each pass keeps of each replica's hidden layers, [R, passes, depth, width]."""
        shape = (self._passes, self._networks.shape.depth, self._networks.shape.width)
        drawn = np.stack([_kept(g, shape, self._rate) for g in self._prediction])
        self._kept = torch.from_numpy(drawn).to(self._networks.flat.device)


class WithPriors(Posterior):
    """Networks that each have a prior function beside them."""

    keeps: ClassVar = ()

    def __init__(self, networks: Networks, problem: Problem, name: str, members: int, scale: float) -> None:
        self._networks, self._members, self._scale = networks, members, scale
        self._priors = networks.another(side_by_side(problem.seeds, f"{name}/prior", members))

    def offset(self, inputs: Tensor) -> Tensor:
        """The prior functions [M, rows]."""
        return torch.stack([self._prior(m, rows) for m, rows in enumerate(inputs)])

    def predictor(self, replica: int) -> Predictor:
        """Mean and variance over the members."""
        own = range(replica * self._members, (replica + 1) * self._members)

        def predict(rows: Tensor) -> tuple[Tensor, Tensor]:
            return moments(torch.stack([self._networks.alone(m, rows) + self._prior(m, rows) for m in own]))

        return predict

    def _prior(self, m: int, rows: Tensor) -> Tensor:
        return self._scale * self._priors.alone(m, rows)


class LastLayers(Posterior):
    """Networks whose last layer has a Gaussian posterior around its weights."""

    keeps: ClassVar = ("_precision",)

    def __init__(self, networks: Stack, noise: float, prior_variance: float) -> None:
        self._networks, self._noise, self._prior = networks, noise, prior_variance
        size = networks.shape.width + 1
        eye = torch.eye(size, dtype=torch.float64, device=networks.flat.device)
        self._precision = (eye / prior_variance).repeat(networks.members, 1, 1)

    def fitted(self, inputs: Tensor, shares: Tensor, curvature: Tensor | None = None) -> None:
        """Σ⁻¹ from the summed units of all trajectories; of bits by Laplace's approximation, in which no σ appears."""
        for m, (rows, share) in enumerate(zip(inputs, shares, strict=True)):
            units = _with_one(hidden(rows.flatten(0, 1), self._networks.member(m)[:-1])).view(*share.shape, -1)
            sums = (units * share.unsqueeze(-1)).sum(1).double()
            eye = torch.eye(sums.shape[1], dtype=sums.dtype, device=sums.device)
            if curvature is None:
                self._precision[m] = sums.T @ sums / self._noise**2 + eye / self._prior
            else:
                self._precision[m] = (sums.T * curvature[m].double()) @ sums + eye / self._prior

    def predictor(self, replica: int) -> Predictor:
        """The network's output, and φᵀΣφ = |L⁻¹φ|² where LLᵀ = Σ⁻¹."""
        layers = self._networks.member(replica)
        factor = torch.linalg.cholesky(self._precision[replica])
        eye = torch.eye(len(factor), dtype=factor.dtype, device=factor.device)
        inverse = torch.linalg.solve_triangular(factor, eye, upper=False).T.float()

        def predict(rows: Tensor) -> tuple[Tensor, Tensor]:
            units = hidden(rows, layers[:-1])
            return output(units, layers[-1]), (_with_one(units) @ inverse).square_().sum(-1)

        return predict


def perceptrons(networks: Networks, name: str, option: str) -> Stack:
    """The networks of a model, if they are perceptrons.

    Raises:
        UserError: they are not.
    """
    if isinstance(networks, Stack):
        return networks
    raise UserError(
        f"uncertainty={option} looks into perceptrons, and reward model {name!r} has a network of its own; "
        "take uncertainty=ensemble, which asks networks for their outputs alone, or leave its network out"
    )


def moments(values: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance [n] over the first dimension [B, n]."""
    mean = values.mean(0)
    return mean, (values - mean).square_().mean(0)


def _kept(generator: np.random.Generator, shape: tuple[int, ...], rate: float) -> np.ndarray:
    """Ones where a unit is kept, zeros where it is dropped, float32."""
    drawn = generator.integers(LEVELS, size=shape, dtype=np.uint16)
    return (drawn >= round(rate * LEVELS)).astype(np.float32)


def _with_one(units: Tensor) -> Tensor:
    return torch.nn.functional.pad(units, (0, 1), value=1.0)

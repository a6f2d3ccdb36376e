"""From the numbers that an actor's network gives to actions: the best one, one that explores, and probabilities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torch.distributions import Categorical
from torchrl.modules import ProbabilisticActor, TanhNormal

from credit.agents.torchrl.noise import NoiseKind
from credit.core.problem import FLOAT


class Head(ABC):
    """What a network's outputs mean.

    Args:
        actions: A, how many there are, or how many numbers are in one.

    Attributes:
        outputs: of the network. noise: kind of the numbers that exploration needs. width: how many a step.
    """

    noise: ClassVar[NoiseKind]
    outputs: int
    width: int

    @abstractmethod
    def actor(self, network: nn.Module) -> Any:
        """TorchRL's actor with a network: `observation` → `action`."""

    @abstractmethod
    def best(self, raw: Tensor) -> Tensor:
        """The action without exploration, of outputs [..., outputs]."""

    @abstractmethod
    def explored(self, raw: Tensor, noise: Tensor) -> Tensor:
        """An action with it; noise [..., width]."""

    def best_probabilities(self, raw: Tensor) -> Tensor | None:
        """Of all actions [..., A] where the best is taken; None where they are not finite."""
        return None

    def probabilities(self, raw: Tensor) -> Tensor | None:
        """Of all actions [..., A] where one explores; None where they are not finite."""
        return None


class Categories(Head):
    """Logits of A actions; one is drawn by its probability."""

    noise = "uniform"

    def __init__(self, actions: int) -> None:
        self.outputs, self.width = actions, 1

    def actor(self, network: nn.Module) -> Any:
        """With `Categorical`."""
        return ProbabilisticActor(
            TensorDictModule(network, in_keys=["observation"], out_keys=["logits"]),
            in_keys=["logits"],
            distribution_class=Categorical,
            return_log_prob=True,
        )

    def best(self, raw: Tensor) -> Tensor:
        """The likeliest, int64 [...]."""
        return raw.argmax(-1)

    def explored(self, raw: Tensor, noise: Tensor) -> Tensor:
        """The action at whose place the cumulated probabilities pass a uniform number."""
        passed = raw.softmax(-1).cumsum(-1) <= noise
        return passed.sum(-1).clamp(max=self.outputs - 1)

    def best_probabilities(self, raw: Tensor) -> Tensor:
        """One for the likeliest, zero for the others."""
        return torch.nn.functional.one_hot(self.best(raw), self.outputs).to(FLOAT)

    def probabilities(self, raw: Tensor) -> Tensor:
        """Softmax."""
        return raw.to(FLOAT).softmax(-1)


class Squashed(Head):
    """Mean and deviation of A normal numbers u; an action is tanh u."""

    noise = "normal"

    def __init__(self, actions: int) -> None:
        self.outputs, self.width = 2 * actions, actions
        self._extract = NormalParamExtractor()

    def actor(self, network: nn.Module) -> Any:
        """With `TanhNormal`."""
        return ProbabilisticActor(
            TensorDictModule(nn.Sequential(network, self._extract), in_keys=["observation"], out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=TanhNormal,
            return_log_prob=True,
        )

    def best(self, raw: Tensor) -> Tensor:
        """tanh of the mean [..., A]."""
        return raw.chunk(2, -1)[0].tanh()

    def explored(self, raw: Tensor, noise: Tensor) -> Tensor:
        """tanh(μ + σε)."""
        loc, scale = self._extract(raw)
        return torch.addcmul(loc, scale, noise).tanh()


class Bounded(Head):
    """A numbers, squashed: a deterministic actor.

    Args:
        actions: A. deviation: of the normal noise that exploration adds.
    """

    noise = "normal"

    def __init__(self, actions: int, deviation: float) -> None:
        self.outputs = self.width = actions
        self._deviation = deviation

    def actor(self, network: nn.Module) -> Any:
        """A module without a distribution."""
        return TensorDictModule(nn.Sequential(network, nn.Tanh()), in_keys=["observation"], out_keys=["action"])

    def best(self, raw: Tensor) -> Tensor:
        """tanh [..., A]."""
        return raw.tanh()

    def explored(self, raw: Tensor, noise: Tensor) -> Tensor:
        """With normal noise, within [−1, 1]."""
        return torch.add(raw.tanh(), noise, alpha=self._deviation).clamp(-1, 1)

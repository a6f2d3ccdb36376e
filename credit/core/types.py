"""The few records that pass between the rooms.

Shapes everywhere: R replicas, K windows, T steps, S states, A actions, M models, B draws, d features, and N cells of
the pseudo-reward: the S·A pairs (s, a) with index n = s·A + a, unless reward models look at something else. Tabular
tensors are float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import torch
from annotated_types import Ge, Gt, Interval
from torch import Tensor

from credit.core.cells import PAIRS, Axis, Cells
from credit.core.cells import Steps as Steps

# Ranges: the check derives its schema from signatures, so a range is written here and nowhere else.
Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
Probability = Annotated[float, Interval(ge=0, le=1)]
PositiveInt = Annotated[int, Ge(1)]
NonNegativeInt = Annotated[int, Ge(0)]

FLOAT = torch.float64

Credit = Literal["every_step", "last_step"]  # a hypothesis: which steps of a window share its label


class Replicas:
    """R seeds side by side on a device."""

    seeds: tuple[int, ...]
    device: torch.device

    @property
    def replicas(self) -> int:
        """R."""
        return len(self.seeds)

    def zeros(self, *shape: int) -> Tensor:
        """A float64 tensor of zeros [R, *shape]."""
        return torch.zeros(self.replicas, *shape, dtype=FLOAT, device=self.device)


@dataclass(frozen=True)
class Problem(Replicas):
    """What a learner may know before its first step: sizes and the window, never P or r.

    Attributes:
        states: S. actions: A. window: T, steps that share one label.
        seeds: one seed a replica; R = len(seeds).
        device: where tensors live.
        episodic: whether every window starts anew.
        axes: what the pseudo-reward is a table over.
    """

    states: int
    actions: int
    window: int
    seeds: tuple[int, ...]
    device: torch.device
    episodic: bool = False
    axes: tuple[Axis, ...] = PAIRS

    @cached_property
    def cells(self) -> Cells:
        """The N cells of the pseudo-reward."""
        return Cells.over(self.axes, self.window, self.states, self.actions)

    @property
    def pairs(self) -> int:
        """S·A."""
        return self.states * self.actions


@dataclass(frozen=True)
class Windows(Steps):
    """Labelled windows: Steps of shape [R, K, T], labels [R, K].

    Attributes:
        labels: Y, all that a learner is told about a window.
        primitive: r [R, K, T], only for components that declare `sees_primitive` (the oracle); None for all others.
    """

    labels: Tensor
    primitive: Tensor | None = None

    @property
    def lengths(self) -> int:
        """T."""
        return self.states.shape[-1]

    @property
    def final(self) -> Tensor:
        """Whether a step is the last of its window, [R, K, T]."""
        return self.times == self.lengths - 1

    def to_steps(self, values: Tensor) -> Tensor:
        """What a window has [R, K], for each of its steps [R, K, T]."""
        return values.unsqueeze(-1).expand(self.states.shape)


@dataclass(frozen=True)
class Estimate:
    """What one reward model predicts: mean [R, N] from all data, draws [R, B, N] whose spread is its variance."""

    mean: Tensor
    draws: Tensor


@dataclass(frozen=True)
class Belief:
    """What the learner believes about the reward, equations (9)–(19), reference first among the models.

    Attributes:
        models: M names. mean: [R, M, N] fitted r̂_j. draws: [R, B, N] of each model. mse: [R, M, N] proxies (10), (11).
        disagreement: [R, M−1, N] Δ̂² of each surrogate (9). weights: [R, M, N] (14).
        best: [R, N] index of the locally best model (16). mixed: [R, N] (15).
        bonus: name → [R, N]. plan: [R, N] mixed + bonuses (17), (19).
    """

    models: tuple[str, ...]
    mean: Tensor
    draws: tuple[Tensor, ...]
    mse: Tensor
    disagreement: Tensor
    weights: Tensor
    best: Tensor
    mixed: Tensor
    bonus: dict[str, Tensor]
    plan: Tensor


@dataclass(frozen=True)
class Recovery(Belief):
    """What is believed of a table of rewards.

    Attributes:
        visits: [R, N] counts N(s, a). cells: what the N are.
        column: where the draws have each cell [R, N], if only some that stand for all are kept.
    """

    visits: Tensor
    cells: Cells
    column: Tensor | None = None

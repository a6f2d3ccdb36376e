"""What a learner may know before its first step: spaces, windows, seeds and the device; never P or r."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete, Space
from torch import Tensor

from credit.core.cells import PAIRS, Cells
from credit.core.steps import Steps

FLOAT = torch.float64
LabelKind = Literal["bits", "real"]


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
    """Spaces as learners see them: encoded, so that each is a number (`Discrete`) or a vector (`Box`).

    Attributes:
        observation_space: of what an agent sees. action_space: of what it does; vectors lie in [−1, 1].
        window: T, most steps that share one label.
        seeds: one seed a replica; R = len(seeds).
        device: where tensors live.
        episodic: whether there are episodes; else the task goes on for ever.
        horizon: H, most steps of an episode; where nobody says so, a window is an episode.
        labels: of which kind they are, where somebody says so.
        lockstep: whether all replicas take as many steps in every round.
        even: whether all windows have T steps and a label.
        names: of the coordinates of an observation, where the environment says them.

    Example:
        >>> Problem.finite(10, 3, window=7, seeds=(0,))
        >>> Problem.vectors(4, 2, window=300, seeds=(0, 1))
    """

    observation_space: Space
    action_space: Space
    window: int
    seeds: tuple[int, ...]
    device: torch.device
    episodic: bool = False
    horizon: int = 0
    labels: LabelKind | None = None
    lockstep: bool = False
    even: bool = True
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """A window that nobody says to be a part of an episode is one."""
        if not self.horizon:
            object.__setattr__(self, "horizon", self.window)

    @classmethod
    def finite(
        cls,
        states: int,
        actions: int,
        window: int,
        seeds: tuple[int, ...],
        device: torch.device | str = "cpu",
        episodic: bool = False,
    ) -> Problem:
        """States and actions are numbers."""
        spaces = (Discrete(states), Discrete(actions))
        return cls(*spaces, window, tuple(seeds), torch.device(device), episodic)

    @classmethod
    def vectors(
        cls, observations: int, actions: int, window: int, seeds: tuple[int, ...], device: torch.device | str = "cpu"
    ) -> Problem:
        """States are vectors of any numbers, actions vectors of numbers in [−1, 1]; windows are episodes."""
        spaces = (Box(-np.inf, np.inf, (observations,)), Box(-1.0, 1.0, (actions,)))
        return cls(*spaces, window, tuple(seeds), torch.device(device), episodic=True)

    @property
    def finite_states(self) -> bool:
        """Whether a state is a number, 0 … S − 1."""
        return isinstance(self.observation_space, Discrete)

    @property
    def finite_actions(self) -> bool:
        """Whether an action is a number, 0 … A − 1."""
        return isinstance(self.action_space, Discrete)

    @property
    def tabular(self) -> bool:
        """Whether the pseudo-reward can be a table."""
        return self.finite_states and self.finite_actions

    @property
    def states(self) -> int:
        """S, where they are finite."""
        return _count(self.observation_space)

    @property
    def observations(self) -> int:
        """O, numbers in a state, where it is a vector."""
        return _size(self.observation_space)

    @property
    def actions(self) -> int:
        """A: how many actions there are, or how many numbers are in one."""
        return _count(self.action_space) if self.finite_actions else _size(self.action_space)

    @property
    def pairs(self) -> int:
        """S·A."""
        return self.states * self.actions

    def blank(self) -> Steps:
        """One step of zeros [1]: what feature maps are tried on."""
        number = torch.zeros(1, dtype=torch.int64, device=self.device)
        state = number if self.finite_states else torch.zeros(1, self.observations, device=self.device)
        action = number if self.finite_actions else torch.zeros(1, self.actions, device=self.device)
        return Steps(state, action, state, number)

    @cached_property
    def cells(self) -> Cells:
        """The S·A pairs as cells."""
        return Cells.over(PAIRS, self.horizon, self.states, self.actions)


def _count(space: Space) -> int:
    assert isinstance(space, Discrete), f"{space} is not finite"
    return int(space.n)


def _size(space: Space) -> int:
    assert isinstance(space, Box), f"{space} holds no vectors"
    return int(np.prod(space.shape))

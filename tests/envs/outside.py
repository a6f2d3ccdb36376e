"""Somebody else's environment, with no more than it must have."""

from __future__ import annotations

from typing import ClassVar

import gymnasium
import numpy as np
import torch
from torch import Tensor

from credit.core.problem import FLOAT, Problem
from credit.core.seams import Environment, Transitions
from credit.core.streams import generators
from credit.envs import spaces

from .collecting import Follow


class Shelves(Environment):
    """Somebody else's environment: two shelves, filled by a push in (−2, 4); it has no more than it must.

    A state is MultiDiscrete([4, 3]), an action a box. Shelf 0 rises with every push above 1; when it is full the
    episode is over and pays 1. Shelf 1 counts pushes modulo 3.
    """

    setting: ClassVar = "episodic"
    keeps: ClassVar = ("_shelves", "_noise")

    def __init__(self, view: spaces.View = "auto") -> None:
        self.seen = spaces.observations(gymnasium.spaces.MultiDiscrete([4, 3]), view)
        self.done = spaces.actions(gymnasium.spaces.Box(-2.0, 4.0, (1,)))

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        return spaces.problem(self.seen, self.done, window, seeds, device)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self._shelves = np.zeros((problem.replicas, copies, 2), dtype=np.int64)
        self._noise = generators(problem.seeds, f"shelves, {purpose}")

    def reset(self, mask: Tensor | None = None) -> Tensor:
        drawn = np.stack([g.integers(2, size=self._shelves.shape[1]) for g in self._noise])
        fresh = np.stack([drawn, np.zeros_like(drawn)], -1)
        self._shelves = fresh if mask is None else np.where(mask.numpy()[..., None], fresh, self._shelves)
        return self.seen(self._shelves)

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        push = self.done(actions)[..., 0].numpy()
        moved = self._shelves + np.stack([push > 1, np.ones_like(push, dtype=bool)], -1)
        moved = np.stack([moved[..., 0].clip(max=3), moved[..., 1] % 3], -1)
        if mask is not None:
            moved = np.where(mask.numpy()[..., None], moved, self._shelves)
        self._shelves = moved
        full = torch.from_numpy(moved[..., 0] == 3)
        return Transitions(self.seen(moved), full.to(FLOAT) + 0.25, full, torch.zeros_like(full))


class Corridor(Environment):
    """Four rooms in a row; whoever has gone right three times is out, for a reward of 1. Nobody knows P or r."""

    setting: ClassVar = "episodic"

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        return Problem.finite(4, 2, window, seeds, device, episodic=True)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self._room = torch.zeros(problem.replicas, copies, dtype=torch.int64)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        self._room = torch.zeros_like(self._room) if mask is None else self._room.masked_fill(mask, 0)
        return self._room

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        moved = (self._room + 2 * actions - 1).clamp(0, 3)
        self._room = moved if mask is None else torch.where(mask, moved, self._room)
        out = self._room == 3
        return Transitions(self._room, out.to(FLOAT), out, torch.zeros_like(out))


def pushes(*rising: int) -> Follow:
    """Each replica pushes hard in every n-th step."""

    def act(states: Tensor, step: Tensor) -> Tensor:
        every = torch.tensor(rising).view(-1, 1)
        return torch.where(step % every == 0, 0.9, -1.0).unsqueeze(-1)

    return Follow(act)

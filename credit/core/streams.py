"""Random numbers that depend on (seed, purpose) alone, so that a replica draws the same in any batch."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from credit.core.problem import Problem, Replicas
from credit.core.state import Stateful

Kind = Literal["uniform", "normal", "poisson"]


def generators(seeds: Sequence[int], purpose: str) -> list[np.random.Generator]:
    """One NumPy generator a seed; different purposes give independent streams."""
    key = zlib.crc32(purpose.encode())
    return [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,))) for seed in seeds]


def reset_seed(seed: int, purpose: str, copy: int, episode: int) -> int:
    """What an environment that seeds itself is reset with: one number for each episode of each copy."""
    key = (zlib.crc32(purpose.encode()), copy, episode)
    return int(np.random.SeedSequence(seed, spawn_key=key).generate_state(1)[0])


def side_by_side(seeds: Sequence[int], purpose: str, members: int) -> list[np.random.Generator]:
    """One generator for each of E networks of each replica, those of a replica together."""
    each = [generators(seeds, f"{purpose} {member}") for member in range(members)]
    return [generator for own in zip(*each, strict=True) for generator in own]


class Stream(Stateful):
    """A buffered stream of random rows, one row [R, width] a call.

    Args:
        problem: gives the seeds and the device.
        purpose: what the numbers are for; two streams of one purpose are equal.
        kind: `uniform` on [0, 1), standard `normal`, or `poisson` with mean 1.
        width: numbers per replica and call.

    Example:
        >>> u = Stream(problem, "environment", "uniform", width=7).next()  # [R, 7]
    """

    acts: ClassVar = ()  # whoever acts anew draws anew
    CHUNK = 2**13  # numbers drawn at once for a replica: a generator call costs more than a number

    def __init__(self, problem: Replicas, purpose: str, kind: Kind, width: int) -> None:
        self._generators = generators(problem.seeds, purpose)
        self._kind = kind
        self._width = width
        self._device = problem.device
        self._rows: Sequence[Tensor] = ()
        self._used = 0
        self._before: list[Any] = []  # where the generators stood before these rows were drawn

    def next(self) -> Tensor:
        """The next row of every replica, float64 [R, width]."""
        if self._used == len(self._rows):
            self._fill()
        self._used += 1
        return self._rows[self._used - 1]

    def several(self, count: int) -> Tensor:
        """The next rows of every replica side by side [R, count·width]."""
        return self.next() if count == 1 else torch.cat([self.next() for _ in range(count)], dim=1)

    def rows(self, step: Tensor) -> Tensor:
        """The next row of every copy [R, K, width], at any steps of their episodes [R, K]."""
        if (copies := step.shape[1]) == 1:
            return self.next().unsqueeze(1)
        return torch.stack([self.next() for _ in range(copies)], dim=1)

    def state_dict(self) -> dict[str, Any]:
        """Where the generators stood before the buffered rows, and how many of those are used."""
        return {"generators": self._before or self._now(), "used": self._used}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Draw the buffered rows again."""
        for generator, before in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = before
        self._rows, self._before, self._used = (), [], 0
        if state["used"]:
            self._fill()
            self._used = state["used"]

    def _now(self) -> list[Any]:
        return [g.bit_generator.state for g in self._generators]

    def _fill(self) -> None:
        self._before = self._now()
        self._rows = torch.from_numpy(self._draw()).to(self._device).unbind()
        self._used = 0

    def _draw(self) -> np.ndarray:
        shape = (max(self.CHUNK // self._width, 1), self._width)
        return np.stack([drawn(g, self._kind, shape) for g in self._generators], axis=1)


class Episodes(Stateful):
    """A row for every copy at every step of episodes that begin together: all are drawn as they begin, so that none
    depends on how long others last. The numbers are those of `Stream` where all last to the horizon.

    Args:
        problem: gives the horizon, the seeds and the device. purpose: what the numbers are for. kind: as in `Stream`.
        width: numbers in a row.
    """

    keeps: ClassVar = ("_generators",)
    acts: ClassVar = ()

    def __init__(self, problem: Problem, purpose: str, kind: Kind, width: int) -> None:
        self._generators = generators(problem.seeds, purpose)
        self._kind: Kind = kind
        self._horizon, self._width, self._device = problem.horizon, width, problem.device
        self._rows: Sequence[Tensor] = ()

    def rows(self, step: Tensor) -> Tensor:
        """Those of a step that all copies take [R, K] → [R, K, width]."""
        now = int(step.flatten()[0])
        if now == 0:
            shape = (self._horizon, step.shape[1], self._width)
            each = np.stack([drawn(generator, self._kind, shape) for generator in self._generators], 1)
            self._rows = torch.from_numpy(each).to(self._device).unbind()
        return self._rows[now]


def each_step(problem: Problem, purpose: str, kind: Kind, width: int) -> Stream | Episodes:
    """Rows for the copies that act, step by step, whether or not a replica may take more steps in a round than others.

    Args:
        problem, purpose, kind, width: as in `Stream`.
    """
    return (Stream if problem.even or problem.lockstep else Episodes)(problem, purpose, kind, width)


class Queues(Stateful):
    """A stream for each replica, of which each takes as many rows as it needs: the numbers are those of `Stream`.

    Args:
        problem: gives the seeds and the device. purpose: what the numbers are for. kind: as in `Stream`.
        width: numbers in a row.
    """

    keeps: ClassVar = ("_generators",)
    acts: ClassVar = ()

    def __init__(self, problem: Replicas, purpose: str, kind: Kind, width: int) -> None:
        self._generators = generators(problem.seeds, purpose)
        self._kind: Kind = kind
        self._width, self._device = width, problem.device

    def take(self, wanted: Tensor) -> Tensor:
        """A row for every place that wants one [R, K], in their order: float64 [R, K, width], 0 elsewhere."""
        found = np.zeros((*wanted.shape, self._width))
        for own, mask, generator in zip(found, wanted.cpu().numpy(), self._generators, strict=True):
            own[mask] = drawn(generator, self._kind, (int(mask.sum()), self._width))
        return torch.from_numpy(found).to(self._device)


def drawn(generator: np.random.Generator, kind: Kind, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of a kind, float64."""
    if kind == "uniform":
        return generator.random(shape)
    return generator.standard_normal(shape) if kind == "normal" else generator.poisson(1.0, shape).astype(np.float64)

"""Environments of EnvPool side by side, each stepped by a thread of its own in C++."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from credit.core.errors import RAISED, UserError, nearest
from credit.envs.gymnasium.copies import Here, Out, told

LARGEST = 2**31 - 1  # that a seed or a number of steps may be there


class Pooled(gymnasium.Env[Any, Any]):
    """One environment of EnvPool with Gymnasium's face.

    A pool's seed is fixed when it is made, and behind an end it begins another episode by itself. So each episode has a
    pool of its own, of one environment: that costs .6 ms (classic control) to 3 ms (MuJoCo) an episode.

    Args:
        id: as `envpool.make` takes it. kwargs: for that. max_steps: of an episode; None for its own, −1 for no limit.

    Raises:
        UserError: it is not there, or cannot be made.
    """

    def __init__(self, id: str, kwargs: Mapping[str, Any], max_steps: int | None) -> None:
        try:
            import envpool
        except ImportError as error:
            raise UserError(
                f"env.backend=envpool needs the package envpool, and it cannot be imported ({error}): pip install "
                "'credit-rl[envpool]', or leave env.backend out"
            ) from None
        there = envpool.list_all_envs()
        if id not in there:
            raise UserError(
                f"env.id={id!r}: EnvPool has no such environment; {nearest(id, there).partition(' (')[0]}; or leave "
                "env.backend out"
            )
        limit = {} if max_steps is None else {"max_episode_steps": max_steps if max_steps > 0 else LARGEST}
        self._make = partial(envpool.make, id, env_type="gymnasium", num_envs=1, num_threads=1, **limit, **kwargs)
        try:
            self._pool = self._seeded(0)
        except RAISED as error:
            given = f", made with {dict(kwargs)}" if kwargs else ""
            raise UserError(f"env.id={id!r}{given} cannot be made: {type(error).__name__}: {error}") from error
        self.max_steps = int(self._pool.spec.config.max_episode_steps)

    def _seeded(self, seed: int) -> Any:
        with warnings.catch_warnings():  # that bounds are rounded to the numbers in which it gives them
            warnings.simplefilter("ignore", UserWarning)
            pool = self._make(seed=seed)
            self.observation_space, self.action_space = pool.single_observation_space, pool.single_action_space
            return pool

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """The first observation of an episode."""
        if seed is not None:
            self._pool = self._seeded(seed % LARGEST)
        seen, info = self._pool.reset()
        return _only(seen), _only(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step, waited for."""
        self.send(action)
        return self.receive()

    def send(self, action: Any) -> None:
        """Begin a step."""
        self._pool.send(np.asarray([action], dtype=self.action_space.dtype))

    def receive(self) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """What the step that was begun led to."""
        seen, reward, terminated, truncated, info = self._pool.recv()
        return _only(seen), float(reward[0]), bool(terminated[0]), bool(truncated[0]), _only(info)


class Pools(Here):
    """N environments of EnvPool, whose threads step at the same time."""

    def step(self, which: Sequence[int], actions: Sequence[Any]) -> list[Out]:
        """One step each."""
        for n, action in zip(which, actions, strict=True):
            told(self._envs[n].send, n, action)  # type: ignore[attr-defined]
        return [Out(*told(self._envs[n].receive, n)) for n in which]  # type: ignore[attr-defined]


def _only(values: Any) -> Any:
    """What the only environment of a pool says."""
    if isinstance(values, Mapping):
        return {key: _only(part) for key, part in values.items()}
    if isinstance(values, tuple):
        return tuple(map(_only, values))
    return values[0] if isinstance(values, np.ndarray) and values.ndim else values

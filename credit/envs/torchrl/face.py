"""The face of a Gymnasium environment on one of TorchRL."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Dict
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Compose, EnvBase, StepCounter, Transform, TransformedEnv

from credit.envs.torchrl.specs import space


class Face(gymnasium.Env[Any, Any]):
    """A single TorchRL environment; a seed makes an episode what it is.

    Many draw from torch's global generator: each has a state of that for itself, and leaves it to others as it was.

    Args:
        env: with one action, one reward and no batch. seen: names of the observations that are seen, in this order.
        told: names of observations that are `info` instead.

    Attributes:
        limit: most steps of an episode as the environment says it, None where it does not.
    """

    def __init__(self, env: EnvBase, seen: Sequence[str], told: Sequence[str]) -> None:
        self._env, self._seen, self._told = env, tuple(seen), tuple(told)
        self._act, self._reward = env.action_key, env.reward_key
        self._specs = {name: env.observation_spec[name] for name in self._seen}
        parts = OrderedDict((name, space(spec)) for name, spec in self._specs.items())  # others would be sorted
        self.observation_space = Dict(parts) if len(parts) > 1 else parts[self._seen[0]]
        self.action_space = space(env.action_spec)
        self.limit = limit(env)
        self._generator: Tensor | None = None  # the state of torch's, as this environment left it

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """The first observation of an episode, after `set_seed`."""
        with self._own():
            if seed is not None:
                torch.default_generator.manual_seed(seed)
                self._env.set_seed(seed, static_seed=True)
            self._now = self._env.reset()
        return self._observation(self._now), self._info(self._now)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step; what ends an episode without terminating it has truncated it."""
        with self._own():
            out = self._env.step(self._now.set(self._act, self._env.action_spec.encode(np.asarray(action))))
            self._now = self._env.step_mdp(out)
        then = out["next"]
        done, terminated = (bool(then.get(name).any()) for name in ("done", "terminated"))
        reward = float(then.get(self._reward))
        return self._observation(then), reward, terminated, done and not terminated, self._info(then)

    def close(self) -> None:
        """Let it go."""
        if not self._env.is_closed:
            self._env.close()

    def _observation(self, found: TensorDictBase) -> Any:
        parts = {name: spec.to_numpy(found.get(name)) for name, spec in self._specs.items()}
        return parts if len(parts) > 1 else parts[self._seen[0]]

    def _info(self, found: TensorDictBase) -> dict[str, Any]:
        return {name: bool(found.get(name).any()) for name in self._told}

    @contextmanager
    def _own(self) -> Iterator[None]:
        """Torch's global generator where this environment left it."""
        outside = torch.get_rng_state()
        if self._generator is not None:
            torch.set_rng_state(self._generator)
        try:
            with torch.no_grad():
                yield
        finally:
            self._generator = torch.get_rng_state()
            torch.set_rng_state(outside)


def limit(env: EnvBase) -> int | None:
    """Most steps of an episode, where a `StepCounter`, a Gymnasium environment inside, or `max_steps` says so."""
    counters = [part.max_steps for part in transforms(env) if isinstance(part, StepCounter)]
    registered = getattr(getattr(env, "spec", None), "max_episode_steps", None)
    found = [*counters, registered, getattr(env, "max_steps", None)]
    return min((number for number in found if isinstance(number, int) and number > 0), default=None)


def transforms(env: EnvBase) -> list[Transform]:
    """Those around an environment, the innermost first."""
    if not isinstance(env, TransformedEnv):
        return []
    return list(env.transform) if isinstance(env.transform, Compose) else [env.transform]

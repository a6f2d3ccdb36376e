"""One environment by what makes it, and what to do where that is none, or not a single one."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
from torchrl.envs import EnvBase, RewardSum, StepCounter

from credit.core.errors import RAISED, UserError, nearest
from credit.envs.torchrl.face import Face, transforms


def make(
    target: str, kwargs: Mapping[str, Any], keys: Sequence[str] | None, told: Sequence[str], max_steps: int | None
) -> gymnasium.Env[Any, Any]:
    """One environment with Gymnasium's face.

    Args:
        target: what makes it. kwargs: for that. keys: of what is seen; None for all but what only counts and what is
            told. told: keys of observations that say whether a step is a success. max_steps: of an episode, None for
            its own.

    Raises:
        UserError: it is not there, cannot be made, or is many.
    """
    maker = named(target)
    try:
        env = maker(**kwargs)
    except RAISED as error:  # whatever somebody's constructor may raise
        given = f", made with {dict(kwargs)}" if kwargs else ""
        raise UserError(f"env.target={target!r}{given} cannot be made: {type(error).__name__}: {error}") from error
    if not isinstance(env, EnvBase):
        raise UserError(
            f"env.target={target!r} gave a {type(env).__name__}, which is no torchrl.envs.EnvBase; an environment of "
            "Gymnasium is env=gymnasium env.id=…"
        )
    _require_single(env, target)
    there = list(env.observation_spec.keys())
    told = [key for key in told if key in there]
    face = Face(env, _seen(env, target, keys, there, told), told)
    return face if max_steps is None else gymnasium.wrappers.TimeLimit(face, max_steps)


def named(target: str) -> Callable[..., Any]:
    """What a dotted path leads to.

    Raises:
        UserError: nothing that can be called.
    """
    module, _, name = target.replace(":", ".").rpartition(".")
    what = "give the dotted path of a TorchRL environment, or of a function that returns one: torchrl.envs.GymEnv"
    if not module:
        raise UserError(f"env.target={target!r} is no dotted path; {what}")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise UserError(f"env.target={target!r} is not there: {error}; {what}") from None
    if not callable(found):
        raise UserError(f"env.target={target!r} is a {type(found).__name__}, which makes nothing; {what}")
    return found


def _seen(
    env: EnvBase, target: str, keys: Sequence[str] | None, there: Sequence[str], told: Sequence[str]
) -> Sequence[str]:
    """The observations that are seen: those that are named, or all but those that only keep count.

    Raises:
        UserError: one that is not there, or that repeats the reward.
    """
    parts = transforms(env)
    sums = [key for part in parts if isinstance(part, RewardSum) for key in part.out_keys]
    counts = [part.step_count_key for part in parts if isinstance(part, StepCounter)]
    for key in keys or ():
        if key in sums:
            raise UserError(f"env.keys: {key!r} of env.target={target!r} repeats the reward, which no learner sees")
        if key not in there:
            raise UserError(f"env.keys: {key!r} is no observation of env.target={target!r}; {nearest(key, there)}")
    found = keys or [key for key in there if key not in (*told, *sums, *counts)]
    if not found:
        raise UserError(f"env.target={target!r} has nothing to see, only {', '.join(there) or 'no observations'}")
    return found


def _require_single(env: EnvBase, target: str) -> None:
    """Refuse many environments, and many who act."""
    if env.batch_size:
        many = list(env.batch_size)
        if not env.is_closed:
            env.close()
        raise UserError(
            f"env.target={target!r} is already many (batch_size {many}, batch_locked={env.batch_locked}), and each "
            "copy begins its episodes by itself, with a seed of its own: give a single one, whose batch_size is [], "
            f"and say env.copies={many[0]} (env.workers=… steps them in other processes)"
        )
    for what, keys in (("actions", env.action_keys), ("rewards", env.reward_keys)):
        if len(keys) != 1:
            raise UserError(
                f"env.target={target!r} has {len(keys)} {what} ({', '.join(map(str, keys))}), and an agent here has "
                "one; give a function that returns it with one"
            )
    if (shape := env.full_reward_spec[env.reward_key].shape).numel() != 1:
        raise UserError(
            f"env.target={target!r} has a reward of {shape.numel()} numbers {list(shape)}, and a step has one; give a "
            "function that returns it in torchrl.envs.LineariseRewards, or with one"
        )

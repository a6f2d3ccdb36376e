"""One environment by its id, and what to do where there is none."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import gymnasium

from credit.core.errors import RAISED, UserError, nearest
from credit.envs.mujoco import warn_once

PACKAGES = {  # how an id begins → the package that registers it, which may not say so by itself
    "Adroit": "gymnasium_robotics",
    "AntMaze": "gymnasium_robotics",
    "Fetch": "gymnasium_robotics",
    "PointMaze": "gymnasium_robotics",
    "BabyAI": "minigrid",
    "MiniGrid": "minigrid",
    "Sepsis/": "icu_sepsis",
}
NO_LIMIT = -1  # of steps of an episode, whatever an id was registered with
TOO_OLD = ("Fetch", "Hand")  # environments that set up MuJoCo 3 by hand


def make(id: str, kwargs: Mapping[str, Any], max_steps: int | None, wrappers: Sequence[str]) -> gymnasium.Env[Any, Any]:
    """One environment in its wrappers, without Gymnasium's checker, which costs as much as a step.

    Raises:
        UserError: it is not there, or cannot be made.
    """
    found = [wrapper(name) for name in wrappers]
    _import(id)
    if _is_mujoco(id):
        warn_once()
    try:
        env = gymnasium.make(id, max_episode_steps=max_steps, disable_env_checker=True, **kwargs)
        for cls in found:
            env = cls(env)
    except gymnasium.error.UnregisteredEnv as error:
        raise UserError(f"env.id={id!r}: {_first(error)}; {_near(id)}") from None
    except (gymnasium.error.DependencyNotInstalled, ModuleNotFoundError) as error:
        raise UserError(f"env.id={id!r} needs a package that is not installed: {_first(error)}{_where(id)}") from None
    except RAISED as error:  # whatever somebody's constructor may raise
        if id.startswith(TOO_OLD) and int(version("mujoco").partition(".")[0]) > 3:
            raise UserError(
                f"env.id={id!r} cannot be made: gymnasium-robotics {version('gymnasium-robotics')} does not know "
                f"MuJoCo {version('mujoco')}, which credit needs; its mazes and Adroit's hand do"
            ) from None
        given = f", made with {dict(kwargs)}" if kwargs else ""
        raise UserError(f"env.id={id!r}{given} cannot be made: {type(error).__name__}: {_first(error)}") from error
    return env


def wrapper(name: str) -> Any:
    """A wrapper by its name.

    Raises:
        UserError: there is none.
    """
    module, _, cls = name.rpartition(":")
    own = not module
    try:
        return getattr(gymnasium.wrappers if own else importlib.import_module(module), cls)
    except (ImportError, AttributeError) as error:
        known = [word for word in dir(gymnasium.wrappers) if word[0].isupper()]
        hint = nearest(cls, known) if own else str(error)
        raise UserError(
            f"env.wrappers: there is no {name!r}; give a class of gymnasium.wrappers, or package.module:Class; {hint}"
        ) from None


def _is_mujoco(id: str) -> bool:
    """Whether an environment is made with MuJoCo, as far as can be told before it is made."""
    spec = gymnasium.registry.get(id.rpartition(":")[2])
    place = "" if spec is None else str(spec.entry_point)
    return "mujoco" in sys.modules or any(name in place for name in ("mujoco", "gymnasium_robotics"))


def _package(id: str) -> str | None:
    return next((package for start, package in PACKAGES.items() if id.startswith(start)), None)


def _import(id: str) -> None:
    """Import what registers an id, where credit knows it and it is there."""
    package = _package(id)
    if package and id not in gymnasium.registry and importlib.util.find_spec(package):
        gymnasium.register_envs(importlib.import_module(package))


def _where(id: str) -> str:
    """Where the module of a `module:id` is looked for, which may be one of the user's own."""
    return " A module of yours is found in the working folder, or where PYTHONPATH says." if ":" in id else ""


def _near(id: str) -> str:
    package = _package(id)
    if package and not importlib.util.find_spec(package):
        return f"install the package {package}, which has such ids"
    names = [name for name in gymnasium.registry if not name.startswith(("phys2d", "tabular"))]
    return f"{nearest(id, names).partition(' (')[0]}; an id of a package that registers its own is package:id"


def _first(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]

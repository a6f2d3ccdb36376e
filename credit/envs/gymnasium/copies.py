"""Single environments side by side: each is seeded, reset and stepped by itself, and never resets by itself.

Gymnasium's own vectors are not used: `make_vec` may give a class with one generator for all copies, and by default a
vector resets a finished copy within `step` and returns that as if it were one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

import gymnasium

from credit.core.errors import RAISED, RunError, UserError
from credit.envs.facts import number

Make = Callable[[], "gymnasium.Env[Any, Any]"]


class Out(NamedTuple):
    """What one copy said of one step."""

    observation: Any
    reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


class Copies(Protocol):
    """N environments, by number."""

    def reset(self, which: Sequence[int], seeds: Sequence[int]) -> list[Any]:
        """The first observations of new episodes."""

    def step(self, which: Sequence[int], actions: Sequence[Any]) -> list[Out]:
        """One step each.

        Raises:
            RunError: an environment raised.
        """

    def close(self) -> None:
        """Let all go."""


class Here:
    """N environments in this process.

    Args:
        make: one of them. count: N.
    """

    def __init__(self, make: Make, count: int) -> None:
        self._envs = [make() for _ in range(count)]

    def reset(self, which: Sequence[int], seeds: Sequence[int]) -> list[Any]:
        """The first observations of new episodes."""
        return [first(n, told(self._envs[n].reset, n, seed=seed)) for n, seed in zip(which, seeds, strict=True)]

    def step(self, which: Sequence[int], actions: Sequence[Any]) -> list[Out]:
        """One step each."""
        return [out(n, told(self._envs[n].step, n, action)) for n, action in zip(which, actions, strict=True)]

    def frame(self) -> Any:
        """A picture of the first.

        Raises:
            UserError: a package for that is not installed.
        """
        try:
            return self._envs[0].render()
        except gymnasium.error.DependencyNotInstalled as error:
            raise UserError(f"pictures need a package that is not installed: {error}") from None

    def close(self) -> None:
        """Let all go."""
        for env in self._envs:
            env.close()


def told(method: Callable[..., Any], copy: int, *args: Any, **kwargs: Any) -> Any:
    """What an environment says; what it raises names the copy, since whoever hears of it may be another process."""
    try:
        return method(*args, **kwargs)
    except RAISED as error:
        raise Raised(copy, method.__name__, f"{type(error).__name__}: {error}") from error


def first(copy: int, answer: Any) -> Any:
    """The observation of what `reset` gave.

    Raises:
        Broke: that is no observation with its info.
    """
    seen, info = _parts(copy, "reset", answer, ("observation", "info"))
    _require_info(copy, "reset", info)
    return seen


def out(copy: int, answer: Any) -> Out:
    """What `step` gave.

    Raises:
        Broke: that is not what Gymnasium's `step` gives.
    """
    seen, reward, terminated, truncated, info = _parts(copy, "step", answer, Out._fields)
    _require_info(copy, "step", info)
    over, cut = _number(copy, "terminated", terminated), _number(copy, "truncated", truncated)
    return Out(seen, _number(copy, "the reward", reward), bool(over), bool(cut), info)


def _parts(copy: int, method: str, answer: Any, names: tuple[str, ...]) -> tuple[Any, ...]:
    if not isinstance(answer, tuple) or len(answer) != len(names):
        given = f"a tuple of {len(answer)}" if isinstance(answer, tuple) else f"{answer!r}"
        what = f"gave {given}, and since Gymnasium 0.26 it is a tuple of {len(names)}: ({', '.join(names)})"
        raise Broke(copy, method, what)
    return answer


def _number(copy: int, what: str, value: Any) -> float:
    try:
        return number(value)
    except ValueError:
        raise Broke(copy, "step", f"{what} {value!r} is not one number") from None


def _require_info(copy: int, method: str, info: Any) -> None:
    if not isinstance(info, dict):
        raise Broke(copy, method, f"gave {info!r} where info is a dictionary")


class Raised(RunError):
    """An environment raised.

    Attributes:
        copy: its number. method: reset or step. what: type and text.
    """

    did: ClassVar = "raised in"

    def __init__(self, copy: int, method: str, what: str) -> None:
        super().__init__(copy, method, what)
        self.copy, self.method, self.what = copy, method, what

    def __str__(self) -> str:
        return f"copy {self.copy} {self.did} {self.method}: {self.what}"


class Broke(Raised):
    """An environment gave something else than Gymnasium's do."""

    did: ClassVar = "broke the rules of"

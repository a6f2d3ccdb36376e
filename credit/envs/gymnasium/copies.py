"""Single environments side by side: each is seeded, reset and stepped by itself, and never resets by itself.

Gymnasium's own vectors are not used: `make_vec` may give a class with one generator for all copies, and by default a
vector resets a finished copy within `step` and returns that as if it were one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import gymnasium

from credit.core.errors import RunError, UserError

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
        return [told(self._envs[n].reset, n, seed=seed)[0] for n, seed in zip(which, seeds, strict=True)]

    def step(self, which: Sequence[int], actions: Sequence[Any]) -> list[Out]:
        """One step each."""
        return [Out(*told(self._envs[n].step, n, action)) for n, action in zip(which, actions, strict=True)]

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
    except Exception as error:
        raise Raised(copy, method.__name__, f"{type(error).__name__}: {error}") from error


class Raised(RunError):
    """An environment raised.

    Attributes:
        copy: its number. method: reset or step. what: type and text.
    """

    def __init__(self, copy: int, method: str, what: str) -> None:
        super().__init__(copy, method, what)
        self.copy, self.method, self.what = copy, method, what

    def __str__(self) -> str:
        return f"copy {self.copy} raised in {self.method}: {self.what}"
